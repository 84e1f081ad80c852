# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which laser may shine: by a keep-alive, by permit, or by hand for a short time."""

from collections.abc import Callable
from collections.abc import Sequence
from dataclasses import dataclass
import math
import threading
import time

from ivfmc_ros.errors import BusyError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.validation import require_in_range

Clock = Callable[[], float]


@dataclass(frozen=True, kw_only=True)
class BeamRules:
    """
    When a laser may shine.

    hold_timeout : seconds after the last keep-alive until all lasers go off
    limit : seconds that a laser may be on by hand
    permit_required : nothing shines before a permit was given, nor after it was taken away
    permit_timeout : seconds that a permit is good for, 0 for until it is taken away
    """

    hold_timeout: float = 0.5
    limit: float = 10.0
    permit_required: bool = False
    permit_timeout: float = 0.0

    def __post_init__(self) -> None:
        require_in_range('hold_timeout', self.hold_timeout, 0.1, 5.0, 's')
        require_in_range('limit', self.limit, 0.0, 600.0, 's')
        require_in_range('permit_timeout', self.permit_timeout, 0.0, 600.0, 's')


@dataclass(frozen=True, kw_only=True)
class Beam:
    """
    What shall shine.

    laser : the one that is on, None for none
    urgent : nobody vouches for a beam, so that one that is on goes off also while the table moves
    reason : why nothing shines, '' otherwise
    """

    laser: str | None
    urgent: bool
    reason: str


class BeamKeeper:
    """
    Decides, and never waits. Thread safe.

    lasers : the names that there are
    rules : can be replaced at any time
    clock : steady seconds
    """

    def __init__(
        self, lasers: Sequence[str], rules: BeamRules, clock: Clock = time.monotonic
    ) -> None:
        self._lasers = tuple(lasers)
        self.rules = rules
        self._clock = clock
        self._lock = threading.Lock()
        self._held: str | None = None
        self._held_at = -math.inf
        self._refused: str | None = None  # held while somebody pressed stop
        self._hand: str | None = None
        self._hand_until = -math.inf
        self._permitted_at = -math.inf

    @property
    def held(self) -> bool:
        """A keep-alive came lately: frames are wanted, the cell is not idle."""
        return self._clock() - self._held_at <= self.rules.hold_timeout

    def hold(self, name: str) -> None:
        """
        Keep one laser alive; '' is none.

        :raises ParameterError: there is no such laser; then none shines
        """
        with self._lock:
            known = name in self._lasers
            if not self.held or name != self._refused:
                self._refused = None
            self._held_at, self._held = self._clock(), name if known else None
            self._hand = None
        if name and not known:
            raise ParameterError(f'beam_hold: {name!r} is no laser; there are {self._known}')

    def permit(self, allowed: bool) -> None:
        """Give the permit, or take it away."""
        with self._lock:
            self._permitted_at = self._clock() if allowed else -math.inf

    def enable(self, name: str, on: bool, moving: bool) -> None:
        """
        Turn a laser on by hand, for at most ``limit`` seconds, or off.

        :raises BusyError: the cell is not idle
        :raises ParameterError: there is no such laser, or no permit
        """
        if name not in self._lasers:
            raise ParameterError(f'enable: {name!r} is no laser; there are {self._known}')
        with self._lock:
            if not on:
                self._hand = None if self._hand == name else self._hand
                return
            if self.held or moving:
                raise BusyError(f'{name}/enable: only in an idle cell; cancel the scan first')
            if not self._permitted:
                raise BusyError(f'{name}/enable: beam_permit is required and not given')
            self._hand, self._hand_until = name, self._clock() + self.rules.limit

    def idle(self) -> None:
        """End what was turned on by hand."""
        with self._lock:
            self._hand = None

    def stopped(self) -> None:
        """Somebody pressed stop: what is held now stays dark until it was let go."""
        with self._lock:
            self._hand = None
            self._refused = self._held if self.held else None

    def decide(self) -> Beam:
        """Return what shall shine now."""
        with self._lock:
            if not self._permitted:
                return Beam(laser=None, urgent=True, reason='beam_permit is not given')
            if self.held:
                if self._held is not None and self._held == self._refused:
                    return Beam(laser=None, urgent=True, reason='stopped')
                return Beam(laser=self._held, urgent=False, reason='')
            if self._hand is not None and self._clock() < self._hand_until:
                return Beam(laser=self._hand, urgent=False, reason='')
            self._hand = None
            return Beam(laser=None, urgent=True, reason='no beam_hold')

    @property
    def _permitted(self) -> bool:
        rules = self.rules
        if not rules.permit_required:
            return True
        lasts = rules.permit_timeout or math.inf
        return self._permitted_at > -math.inf and self._clock() - self._permitted_at <= lasts

    @property
    def _known(self) -> str:
        return ', '.join(self._lasers) or 'none'
