# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Motion controllers with Marlin, such as those of 3-D printers, on a serial port."""

from ivfmc_ros.devices.marlin.controller import MarlinController as MarlinController
