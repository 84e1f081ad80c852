# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Emulated controllers of the GRBL family, without a port: bytes in, bytes out."""

from ivfmc_ros.simulation.grbl.firmware import EMULATED as EMULATED
from ivfmc_ros.simulation.grbl.machine import GrblMachine as GrblMachine
