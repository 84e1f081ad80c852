# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Motion controllers of the GRBL family on a serial port.

``dialects`` tells the firmwares apart, ``protocol`` parses lines, ``command_channel`` sends
commands, ``monitor`` keeps the state, and
``GrblController`` implements the protocol ``MotionController`` with them.
"""

from ivfmc_ros.devices.grbl.controller import GrblController as GrblController
