# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Status reports and listings in the format of GRBL 1.1 (report.c), for an emulation."""

from collections.abc import Mapping

# Reports from one with work offset, or overrides, to the next: (idle, busy); config.h of GRBL.
_OFFSET_PERIOD, _OVERRIDES_PERIOD = (10, 30), (10, 20)
_MM_PER_INCH = 25.4
# Settings that are listed without decimals.
_INTEGER_SETTINGS = (0, 1, 2, 3, 4, 5, 6, 10, 13, 20, 21, 22, 23, 26, 30, 31, 32)


class ReportFormatter:
    """Formats status reports; work offset and overrides are part of some of them only."""

    def __init__(self) -> None:
        self._offset_in = self._overrides_in = 0

    def include_outputs(self) -> None:
        """Include overrides and outputs in the next report."""
        self._overrides_in = 0

    def status_line(
        self,
        *,
        state: str,
        position: float,
        feed: float,
        rpm: float,
        outputs: str,
        busy: bool,
        inches: bool = False,
    ) -> str:
        """
        Return a status report.

        state : as GRBL names it, with a substate after a colon
        position, feed : units, units per minute
        rpm : spindle speed
        outputs : letters of the outputs that are on
        busy : whether the state is not Idle
        inches : report positions and feed in inches, as with $13=1
        """
        scale, decimals = (1 / _MM_PER_INCH, 4) if inches else (1.0, 3)
        zero = f'{0.0:.{decimals}f}'
        parts = [
            state,
            f'MPos:{position * scale + 0.0:.{decimals}f},{zero},{zero}',
            f'FS:{feed * scale:.0f},{rpm:.0f}',
        ]
        if self._offset_in > 0:
            self._offset_in -= 1
        else:
            self._offset_in = _OFFSET_PERIOD[busy] - 1
            self._overrides_in = self._overrides_in or 1
            parts.append(f'WCO:{zero},{zero},{zero}')
        if self._overrides_in > 0:
            self._overrides_in -= 1
        else:
            self._overrides_in = _OVERRIDES_PERIOD[busy] - 1
            parts.append('Ov:100,100,100')
            if outputs:
                parts.append(f'A:{outputs}')
        return f'<{"|".join(parts)}>\r\n'

    @staticmethod
    def settings(values: Mapping[int, float]) -> str:
        """Return the response to ``$$``, without ok."""
        return ''.join(
            f'${number}={value:.0f}\r\n'
            if number in _INTEGER_SETTINGS
            else f'${number}={value:.3f}\r\n'
            for number, value in sorted(values.items())
        )

    @staticmethod
    def help() -> str:
        """Return the response to ``$``, without ok."""
        commands = '$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x'
        return f'[HLP:{commands}]\r\n'
