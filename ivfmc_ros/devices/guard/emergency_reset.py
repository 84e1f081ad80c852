# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Resets a controller whose driver died: outputs off, motion stopped, within half a second.

It needs nothing of the driver: no settings, no state, not even the firmware: what the other
firmwares take is sent after the reset of the GRBL family, which answers it by errors. The position
is lost where the table moved.
"""

import contextlib
import time

import serial

from ivfmc_ros.devices.fabscan.controller import FabscanController
from ivfmc_ros.devices.grbl import protocol
from ivfmc_ros.devices.marlin.controller import MarlinController
from ivfmc_ros.errors import ControllerLostError

# Seconds of attempts to open the port: the kernel frees that of a killed process late.
_OPEN_S = 2.0
_RETRY_S = 0.02
# Seconds that the table has to brake before the reset turns the outputs off: the beam is on.
_BRAKE_S = 0.3
_TIMEOUT_S = 0.05


def reset_controller(port: str, baud: int) -> None:
    """
    Hold the motion, then reset: all outputs are off when this returns.

    port : device file or pyserial URL
    :raises ControllerLostError: the port cannot be opened or written
    """
    with contextlib.closing(_open(port, baud)) as line:
        try:
            line.write(protocol.HOLD)
            _wait_for_standstill(line)
            # twice: a byte may be lost
            for _ in range(2):
                line.write(protocol.RESET)
            for data, _ in (*MarlinController.OFF_STEPS, *FabscanController.OFF_STEPS):
                line.write(data)
            line.flush()
        except OSError as error:
            raise ControllerLostError(f'port {port}: cannot be written: {error}') from error


def _open(port: str, baud: int) -> serial.Serial:
    deadline = time.monotonic() + _OPEN_S
    while True:
        try:
            return serial.serial_for_url(
                port, baud, timeout=_TIMEOUT_S, write_timeout=_TIMEOUT_S, exclusive=True
            )
        except (OSError, ValueError) as error:
            if time.monotonic() > deadline:
                raise ControllerLostError(f'port {port}: cannot be opened: {error}') from error
            time.sleep(_RETRY_S)


def _wait_for_standstill(line: serial.Serial) -> None:
    deadline, received = time.monotonic() + _BRAKE_S, b''
    while time.monotonic() < deadline:
        line.write(protocol.STATUS)
        received = (received + line.read(256))[-512:]
        if b'<Hold:0' in received or b'<Idle' in received:
            return
