# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Connection to a GRBL controller: waits for its start, finds out its firmware, axis, settings."""

from collections import deque
import contextlib

from ivfmc_ros.devices.grbl import protocol
from ivfmc_ros.devices.grbl.command_channel import CommandChannel
from ivfmc_ros.devices.grbl.dialects import ACCELERATION
from ivfmc_ros.devices.grbl.dialects import AXIS_LETTERS
from ivfmc_ros.devices.grbl.dialects import dialect_of
from ivfmc_ros.devices.grbl.dialects import HOMING
from ivfmc_ros.devices.grbl.dialects import MAX_RATE
from ivfmc_ros.devices.grbl.dialects import MAX_SPINDLE
from ivfmc_ros.devices.grbl.dialects import REPORT_INCHES
from ivfmc_ros.devices.grbl.monitor import GrblMonitor
from ivfmc_ros.devices.motion.axis_units import AxisUnits
from ivfmc_ros.devices.serial_line import SerialLine
from ivfmc_ros.devices.settings import ControllerSettings
from ivfmc_ros.errors import ControllerLostError
from ivfmc_ros.errors import ControllerRefusedError

START_TIMEOUT = 4.0  # seconds; a boot loader listens for two before it starts GRBL
_AUTO_RESET_TIMEOUT = 2.5  # seconds; without a banner, opening the port did not reset GRBL
_SILENT_RESET_TIMEOUT = (
    1.5  # seconds after a reset until a controller counts as one without banner
)
_ADOPTED_TIMEOUT = 0.2  # seconds; the banner, if there was one, has been received already
_MAX_LISTINGS = 5  # of settings, until two agree; at 0.1 % lost bytes one in three is damaged
_MAX_LINES_SHOWN, _MAX_SHOWN = 3, 60  # lines and characters of what an unknown controller sent


class Handshake:
    """The steps from an open port to a controller whose settings and position are known."""

    def __init__(
        self,
        settings: ControllerSettings,
        line: SerialLine,
        channel: CommandChannel,
        monitor: GrblMonitor,
        units: AxisUnits,
    ) -> None:
        self._settings, self._line, self._channel = settings, line, channel
        self._monitor, self._units = monitor, units
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
        Wait for the start, find out firmware and axis, read settings and position.

        :raises ControllerLostError: no controller of the GRBL family answers
        :raises ControllerRefusedError: it does not have the axis, or an output
        """
        self._wait_for_start()
        self._identify()
        self._require_outputs()
        self.read_settings()
        self._require_position()

    def _wait_for_start(self) -> None:
        monitor = self._monitor
        wait = _ADOPTED_TIMEOUT if self._line.adopted else _AUTO_RESET_TIMEOUT
        if not monitor.wait_for_start(wait):
            monitor.expect_start()
            self._line.write(protocol.RESET)
            if not monitor.wait_for_start(_SILENT_RESET_TIMEOUT):
                # some send no banner, also after a reset: the report decides
                monitor.assume_started()
        if not monitor.wait_for_report(START_TIMEOUT):
            raise ControllerLostError(
                f'port {self._settings.port}: no status report of GRBL; {self._said()}'
            )

    def _identify(self) -> None:
        """Find out the firmware by banner and ``$I``, and choose the axis."""
        monitor = self._monitor
        # GRBL refuses it during a motion; what it tells is no condition of the connection
        with contextlib.suppress(ControllerRefusedError):
            self._channel.send('$I')
        banner = monitor.banner
        told = monitor.identity.get('FIRMWARE', '')
        told = told or ('FluidNC' if 'FluidNC' in monitor.identity.get('VER', '') else '')
        firmware = told or (banner.firmware if banner else '')
        version = banner.version if banner else monitor.identity.get('VER', '')
        monitor.dialect = dialect_of(firmware, version)
        self._choose_axis()

    def _choose_axis(self) -> None:
        """:raises ControllerRefusedError: the controller does not have the axis that is set"""
        count = self._monitor.axis_count
        letters = self._monitor.identity.get('AXS', '').rpartition(':')[2]
        letters = letters if len(letters) == count else AXIS_LETTERS[:count]
        self._units.choose(self._settings.axis, letters)

    def _require_outputs(self) -> None:
        known = self._monitor.dialect.outputs
        for laser, output in self._settings.lasers.items():
            if output not in known:
                raise ControllerRefusedError(
                    f'laser_outputs: {output} of laser {laser}: the controller runs '
                    f'{self._monitor.dialect.name}, which has {", ".join(known)}'
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
        index, letter = self._units.index, self._units.letter
        required = [first + index for first in (MAX_RATE, ACCELERATION)]
        numbers = [*required, REPORT_INCHES, HOMING, MAX_SPINDLE]
        readings = self._monitor.readings
        readings.clear()
        for _ in range(_MAX_LISTINGS):
            for query, may_be_refused in self._monitor.dialect.queries(letter, index).items():
                try:
                    self._channel.send(query)
                except ControllerRefusedError:
                    if not may_be_refused:
                        raise
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
                f'the controller has no limits of axis {letter}: {missing[0]} is not set'
            )

    def _require_position(self) -> None:
        """:raises ControllerRefusedError: the reports have no position of the axis."""
        if not self._monitor.wait_for_position(START_TIMEOUT):
            if self._monitor.lost:
                raise ControllerLostError(f'port {self._settings.port}: the connection was lost')
            inches = self._monitor.settings.get(REPORT_INCHES, 0.0)
            raise ControllerRefusedError(
                f'port {self._settings.port}: the status reports have no position of axis '
                f'{self._units.letter} with the decimals of $13={inches:.0f}; {self._said()}'
            )
