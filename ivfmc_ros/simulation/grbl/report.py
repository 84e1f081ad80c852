# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Status reports and listings in the formats of the GRBL family, for an emulation."""

from collections.abc import Mapping

from ivfmc_ros.simulation.grbl.firmware import EmulatedFirmware

# Reports from one with work offset, or overrides, to the next: (idle, busy); config.h of GRBL.
_OFFSET_PERIOD, _OVERRIDES_PERIOD = (10, 30), (10, 20)
_MM_PER_INCH = 25.4
# Settings that are listed without decimals.
_INTEGER_SETTINGS = (0, 1, 2, 3, 4, 5, 6, 10, 13, 20, 21, 22, 23, 26, 30, 31, 32)


class ReportFormatter:
    """Formats status reports; work offset and overrides are part of some of them only."""

    def __init__(self, firmware: EmulatedFirmware) -> None:
        self._firmware = firmware
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
        pins: str = '',
    ) -> str:
        """
        Return a status report.

        state : as GRBL names it, with a substate after a colon
        position, feed : units, units per minute
        rpm : spindle speed
        outputs : letters of the outputs that are on
        busy : whether the state is not Idle
        inches : report positions and feed in inches, as with $13=1
        pins : letters of the inputs that are active
        """
        machine = self._positions(position, inches)
        if self._firmware.old:
            return f'<{state.partition(":")[0]},MPos:{machine},WPos:{machine}>\r\n'
        speed = feed / _MM_PER_INCH if inches else feed
        parts = [state, f'MPos:{machine}{self._firmware.fields}', f'FS:{speed:.0f},{rpm:.0f}']
        if pins:
            parts.append(f'Pn:{pins}')
        if self._offset_in > 0:
            self._offset_in -= 1
        else:
            self._offset_in = _OFFSET_PERIOD[busy] - 1
            self._overrides_in = self._overrides_in or 1
            parts.append(f'WCO:{self._positions(0.0, inches)}')
        if self._overrides_in > 0:
            self._overrides_in -= 1
        else:
            self._overrides_in = _OVERRIDES_PERIOD[busy] - 1
            parts.append('Ov:100,100,100')
            if outputs:
                parts.append(f'A:{outputs}')
        return f'<{"|".join(parts)}>\r\n'

    def _positions(self, position: float, inches: bool) -> str:
        """Return the positions of all axes; the others than that of the table are at 0."""
        texts = []
        for letter in self._firmware.axes:
            # degrees of an axis that turns are no length
            scale, decimals = (1 / _MM_PER_INCH, 4) if inches and letter in 'XYZ' else (1.0, 3)
            value = position * scale if letter == self._firmware.axis else 0.0
            texts.append(f'{value + 0.0:.{decimals}f}')
        return ','.join(texts)

    def settings(self, values: Mapping[int, float]) -> str:
        """Return the response to ``$$``, without ok."""
        if self._firmware.by_path:
            return '$10=1\r\n'
        return ''.join(
            f'${number}={value:.{self._decimals(number)}f}{self._comment(number)}\r\n'
            for number, value in sorted(values.items())
        )

    def setting(self, path: str, values: Mapping[int, float]) -> str | None:
        """Return the response to the query of a setting by its path, None if there is none."""
        axis = self._firmware.axis.lower()
        index = self._firmware.index
        numbers = {
            '/report_inches': 13,
            '30': 30,
            f'/axes/{axis}/max_rate_mm_per_min': 110 + index,
            f'/axes/{axis}/acceleration_mm_per_sec2': 120 + index,
        }
        if values[22]:
            numbers[f'/axes/{axis}/homing/cycle'] = 22
        if not self._firmware.by_path or path not in numbers:
            return None
        value = values[numbers[path]]
        text = ('false', 'true')[bool(value)] if path == '/report_inches' else f'{value:.3f}'
        return f'${path}={text}\r\n'

    def path_number(self, path: str) -> int | None:
        """Return the number of a setting that can be written by its path."""
        known = f'/axes/{self._firmware.axis.lower()}/acceleration_mm_per_sec2'
        return 120 + self._firmware.index if path == known else None

    def _decimals(self, number: int) -> int:
        if number in _INTEGER_SETTINGS:
            return 0
        return self._firmware.decimals if number in range(100, 106) else 3

    def _comment(self, number: int) -> str:
        return f' (setting {number}, unit)' if self._firmware.old else ''

    @staticmethod
    def help() -> str:
        """Return the response to ``$``, without ok."""
        commands = '$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x'
        return f'[HLP:{commands}]\r\n'
