# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Connection to a GRBL controller: waits for its start, checks its version, reads its settings."""

from collections import deque
import re

from ivfmc_ros.devices.grbl import protocol
from ivfmc_ros.devices.grbl.command_channel import CommandChannel
from ivfmc_ros.devices.grbl.monitor import GrblMonitor
from ivfmc_ros.devices.grbl.settings import GrblSettings
from ivfmc_ros.devices.serial_line import SerialLine
from ivfmc_ros.errors import ControllerLostError
from ivfmc_ros.errors import ControllerRefusedError

# Numbers of GRBL's ``$`` settings; the number of an axis is added to the last two.
_REPORT_INCHES, MAX_SPINDLE, HOMING, MAX_RATE, ACCELERATION = 13, 30, 22, 110, 120
START_TIMEOUT = 4.0  # seconds; a boot loader listens for two before it starts GRBL
_AUTO_RESET_TIMEOUT = 2.5  # seconds; without a banner, opening the port did not reset GRBL
_MIN_VERSION = (1, 1)  # of GRBL; 0.9 and before report the state in another format
_MAX_LISTINGS = 5  # of settings, until two agree; at 0.1 % lost bytes one in three is damaged
_MAX_LINES_SHOWN, _MAX_SHOWN = 3, 60  # lines and characters of what an unknown controller sent


class Handshake:
    """The steps from an open port to a controller whose settings and position are known."""

    def __init__(
        self,
        settings: GrblSettings,
        line: SerialLine,
        channel: CommandChannel,
        monitor: GrblMonitor,
    ) -> None:
        self._settings, self._line, self._channel = settings, line, channel
        self._monitor = monitor
        self._received: deque[str] = deque(maxlen=_MAX_LINES_SHOWN)

    def begin(self) -> None:
        """Forget what was received on an earlier connection."""
        self._received.clear()

    def note_line(self, text: str) -> None:
        """Note a line that was received, for the error of a controller that is no GRBL."""
        if text:
            self._received.append(text)

    def run(self) -> None:
        """
        Wait for the start, read settings and position.

        :raises ControllerLostError: GRBL does not answer
        :raises ControllerRefusedError: it is older than 1.1, or does not have the axis
        """
        self._wait_for_start()
        self.read_settings()
        self._require_position()

    def _wait_for_start(self) -> None:
        if not self._monitor.wait_for_start(_AUTO_RESET_TIMEOUT):
            self._monitor.expect_start()
            self._line.write(protocol.RESET)
            self._monitor.wait_for_start(START_TIMEOUT)
        version = self._monitor.version
        if version and _version_number(version) < _MIN_VERSION:
            raise ControllerRefusedError(
                f'port {self._settings.port}: the controller runs GRBL {version}, which has '
                'another protocol; install GRBL 1.1 or later on it'
            )
        if not self._monitor.wait_for_report(START_TIMEOUT):
            raise ControllerLostError(
                f'port {self._settings.port}: no status report of GRBL 1.1; {self._said()}'
            )

    def _said(self) -> str:
        """Return what the controller sent last, for an error message."""
        received = [*self._received, self._line.unfinished.decode('ascii', 'replace')]
        lines = ', '.join(ascii(line[:_MAX_SHOWN]) for line in received if line)
        if not lines:
            return 'nothing was received; check port, baud rate and power'
        return f'received: {lines}; check firmware and baud rate'

    def read_settings(self) -> None:
        """
        Read the settings until two listings agree on each that is needed.

        :raises ControllerLostError: they do not
        :raises ControllerRefusedError: the controller does not have the axis
        """
        index = 'XYZABC'.index(self._settings.axis)
        required = [first + index for first in (MAX_RATE, ACCELERATION)]
        numbers = [*required, _REPORT_INCHES, HOMING, MAX_SPINDLE]
        readings = self._monitor.readings
        readings.clear()
        for _ in range(_MAX_LISTINGS):
            self._channel.send('$$')
            readings.end_listing()
            unsettled = readings.unsettled(numbers)
            if not unsettled:
                break
        else:
            raise ControllerLostError(
                f'port {self._settings.port}: setting ${unsettled[0]} of the controller was read '
                'differently each time; check cable and baud rate'
            )
        self._monitor.settings = readings.values()
        missing = [f'${n}' for n in required if not self._monitor.settings.get(n, 0.0) > 0]
        if missing:
            raise ControllerRefusedError(
                f'the controller has no axis {self._settings.axis}: {missing[0]} is not set'
            )

    def _require_position(self) -> None:
        """:raises ControllerRefusedError: the reports have no position of the axis."""
        if not self._monitor.wait_for_position(START_TIMEOUT):
            if self._monitor.lost:
                raise ControllerLostError(f'port {self._settings.port}: the connection was lost')
            inches = self._monitor.settings.get(_REPORT_INCHES, 0.0)
            raise ControllerRefusedError(
                f'port {self._settings.port}: the status reports have no position of axis '
                f'{self._settings.axis} with the decimals of $13={inches:.0f}; {self._said()}'
            )


def _version_number(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r'\d+', version)[:2])
