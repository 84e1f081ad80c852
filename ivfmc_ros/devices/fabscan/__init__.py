# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Motion controllers with the firmware of FabScan Pi on a serial port."""

from ivfmc_ros.devices.fabscan.controller import FabscanController as FabscanController
