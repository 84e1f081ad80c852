# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Guard of the beam: a process that turns the lasers off when the driver dies or hangs."""

from ivfmc_ros.devices.guard.beam_guard import BeamGuard as BeamGuard
