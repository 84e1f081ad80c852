# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The two outputs of an emulated motion controller that lasers are wired to."""

from collections.abc import Callable
from dataclasses import dataclass

LASER_OUTPUTS = 2


@dataclass(frozen=True, kw_only=True)
class LaserOutputs:
    """
    Power of the outputs; their names are those of GRBL.

    spindle : of the first output, 0 to 1 of full power (Marlin: fan0, Horus and FabScan: laser1)
    coolant : of the second one, 0 or 1 (Marlin: fan1, Horus and FabScan: laser2)
    """

    spindle: float = 0.0
    coolant: float = 0.0


class StickingRelays:
    """Passes the outputs on to the lasers, and keeps those on whose relays are welded."""

    def __init__(self, on_change: Callable[[float, LaserOutputs], None]) -> None:
        """``on_change`` : called with the time and the power of both lasers."""
        self._on_change = on_change
        self._commanded = self._welded = LaserOutputs()

    def switch(self, now: float, outputs: LaserOutputs) -> None:
        """Set the outputs of the controller at a time, seconds."""
        self._commanded = outputs
        self._on_change(
            now,
            LaserOutputs(
                spindle=max(outputs.spindle, self._welded.spindle),
                coolant=max(outputs.coolant, self._welded.coolant),
            ),
        )

    def stick(self) -> None:
        """Weld the relays of the lasers that are on now."""
        self._welded = self._commanded

    def release(self, now: float) -> None:
        """End that at a time, seconds."""
        self._welded = LaserOutputs()
        self.switch(now, self._commanded)
