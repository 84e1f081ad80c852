# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What the members of the GRBL family say, for an emulation: greeting, reports, errors, listings.

Written from the sources of each firmware (see ``devices.grbl.protocol``) and, for Grbl 1.1h,
Grbl 0.9j and grblHAL 20260817, compared with the firmware built for a computer.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field

from ivfmc_ros.simulation.grbl.gcode import GRBL_GROUPS
from ivfmc_ros.simulation.grbl.gcode import HORUS_GROUPS

# Texts of GRBL 0.9 for what GRBL 1.1 numbers.
_OLD_ERRORS = {
    1: 'Expected command letter',
    2: 'Bad number format',
    3: 'Invalid statement',
    4: 'Value < 0',
    5: 'Setting disabled',
    8: 'Not idle',
    9: 'Alarm lock',
    11: 'Line overflow',
    20: 'Unsupported command',
    21: 'Modal group violation',
    22: 'Undefined feed rate',
}
_OLD_ALARMS = {1: 'Hard/soft limit', 2: 'Hard/soft limit', 3: 'Abort during cycle'}
_OLD_ALARMS |= {6: 'Abort during cycle', 8: 'Homing fail', 9: 'Homing fail'}


@dataclass(frozen=True, kw_only=True)
class EmulatedFirmware:
    """
    A firmware of the GRBL family.

    name : as ``EMULATED`` lists it
    banner : sent at each start; '' for none
    boot : sent before the banner after a power-on
    identity : response to ``$I``
    axes : letters of the axes
    axis : letter of the one that turns the table
    old : reports with commas, texts instead of numbers, an alarm for each reset in a hold
    fields : of each status report, after the feed
    messages : sent one after the other at any time, here before a response
    by_path : settings are asked by path, ``$$`` lists few
    decimals : of the settings of an axis
    groups : G-code that is known
    """

    name: str
    banner: str
    boot: str = ''
    identity: str = '[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\n'
    axes: str = 'XYZ'
    axis: str = 'X'
    old: bool = False
    fields: str = ''
    messages: tuple[str, ...] = ()
    by_path: bool = False
    decimals: int = 3
    groups: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: GRBL_GROUPS)

    @property
    def index(self) -> int:
        """Number of the axis that turns the table."""
        return self.axes.index(self.axis)

    def error(self, number: int) -> str:
        """Return the response to a line that is refused."""
        if not self.old:
            return f'error:{number}\r\n'
        return f'error: {_OLD_ERRORS.get(number, f"Invalid gcode ID:{number}")}\r\n'

    def alarm(self, number: int) -> str:
        """Return the line that reports an alarm."""
        return f'ALARM: {_OLD_ALARMS[number]}\r\n' if self.old else f'ALARM:{number}\r\n'

    def message(self, text: str) -> str:
        """Return a message to a human reader."""
        return f'[{text}]\r\n' if self.old else f'[MSG:{text}]\r\n'


_GRBL = EmulatedFirmware(name='grbl', banner="\r\nGrbl 1.1h ['$' for help]\r\n")
_GRBL_09 = EmulatedFirmware(
    name='grbl-0.9',
    banner="\r\nGrbl 0.9j ['$' for help]\r\n",
    identity='[0.9j.20160726:]\r\n',
    old=True,
)
_GRBLHAL = EmulatedFirmware(
    name='grblhal',
    # the port of a board with native USB does not reset it: there may be no banner at all
    banner="\r\nGrblHAL 1.1f ['$' or '$HELP' for help]\r\n",
    identity=(
        '[VER:1.1f.20260817:]\r\n[OPT:VNML+,100,1024,4,0]\r\n[AXS:4:XYZA]\r\n'
        '[NEWOPT:ENUMS,RT+,TC,SED]\r\n[FIRMWARE:grblHAL]\r\n[SIGNALS:D]\r\n'
        '[NVS STORAGE:*EEPROM]\r\n[DRIVER:Simulator]\r\n[DRIVER VERSION:260324]\r\n'
    ),
    axes='XYZA',
    axis='A',
    fields='|Bf:100,1023',
    messages=('[MSG:Warning: probe is not connected]', '[PLUGIN:Keypad v1.42]', '$341=1 echo'),
    decimals=5,
)
_FLUIDNC = EmulatedFirmware(
    name='fluidnc',
    boot='ets Jul 29 2019 12:21:46\r\nrst:0x1 (POWERON_RESET),boot:0x13\r\n'
    '[MSG:INFO: FluidNC v3.7.16 https://github.com/bdring/FluidNC]\r\n',
    banner="\r\nGrbl 3.7 [FluidNC v3.7.16 (esp32-wifi) '$' for help]\r\n",
    identity='[VER:3.7 FluidNC v3.7.16 (esp32-wifi) :]\r\n[OPT:MPHS]\r\n'
    '[MSG: Machine: turntable]\r\n[MSG: Mode=STA:SSID=cell:Status=Connected]\r\n',
    axes='XYZA',
    axis='A',
    fields='|Bf:15,128',
    messages=('[MSG:INFO: Connected - IP is 10.0.0.7]', '[MSG:DBG: Step pulse]', '[GC:G0 G54]'),
    by_path=True,
)
_HORUS = EmulatedFirmware(
    name='horus',
    banner="\r\nHorus 0.2 ['$' for help]\r\n",
    identity='[0.2:]\r\n',
    old=True,
    groups=HORUS_GROUPS,
)
EMULATED = {one.name: one for one in (_GRBL, _GRBL_09, _GRBLHAL, _FLUIDNC, _HORUS)}
