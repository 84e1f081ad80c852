# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Emulated GRBL 1.1 controller.

``GrblMachine`` is the controller without a port, ``ControllerEmulator`` puts it behind a
pseudo-terminal and adds faults.
"""

from ivfmc_ros.simulation.grbl.emulator import ControllerEmulator as ControllerEmulator
from ivfmc_ros.simulation.grbl.machine import GrblMachine as GrblMachine
