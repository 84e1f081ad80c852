# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import errno

import pytest
import serial

from ivfmc_ros.devices.serial_line import SerialLine
from ivfmc_ros.errors import ControllerLostError


def test_port_that_is_not_permitted_says_what_to_do(monkeypatch):
    def refuse(name, *_, **__):
        raise serial.SerialException(errno.EACCES, f'could not open port {name}')

    monkeypatch.setattr(serial, 'serial_for_url', refuse)
    line = SerialLine(
        on_line=lambda text, began: None, on_tick=lambda: None, on_lost=lambda reason: None
    )
    with pytest.raises(ControllerLostError, match=r'/dev/ttyACM0: cannot be opened.*dialout'):
        line.open('/dev/ttyACM0', 115200)
