# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Texts of an emulated GRBL 1.1 board."""

from collections.abc import Mapping

# After how many reports work offset and overrides are said again: (idle, busy).
_OFFSET_EVERY, _OVERRIDES_EVERY = (10, 30), (10, 20)
_WHOLE = (0, 1, 2, 3, 4, 5, 6, 10, 13, 20, 21, 22, 23, 26, 30, 31, 32)


class Reporter:
    """Writes status reports, which do not say everything every time."""

    def __init__(self) -> None:
        self._offset_in = self._overrides_in = 0

    def refresh(self) -> None:
        """Say the outputs with the next report."""
        self._overrides_in = 0

    def line(
        self,
        *,
        state: str,
        position: float,
        feed: float,
        rpm: float,
        outputs: str,
        busy: bool,
    ) -> str:
        """
        Return a status report.

        position, feed : units and units per minute; outputs : letters of what is on
        """
        parts = [
            state,
            f'MPos:{position + 0.0:.3f},0.000,0.000',
            f'FS:{feed:.0f},{rpm:.0f}',
        ]
        if self._offset_in > 0:
            self._offset_in -= 1
        else:
            self._offset_in = _OFFSET_EVERY[busy] - 1
            self._overrides_in = self._overrides_in or 1
            parts.append('WCO:0.000,0.000,0.000')
        if self._overrides_in > 0:
            self._overrides_in -= 1
        else:
            self._overrides_in = _OVERRIDES_EVERY[busy] - 1
            parts.append('Ov:100,100,100')
            if outputs:
                parts.append(f'A:{outputs}')
        return f'<{"|".join(parts)}>\r\n'

    @staticmethod
    def settings(values: Mapping[int, float]) -> str:
        """Return the answer to ``$$``, without its ok."""
        return ''.join(
            f'${number}={value:.0f}\r\n' if number in _WHOLE else f'${number}={value:.3f}\r\n'
            for number, value in sorted(values.items())
        )

    @staticmethod
    def help() -> str:
        """Return the answer to ``$``, without its ok."""
        commands = '$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x'
        return f'[HLP:{commands}]\r\n'
