# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Control of a scan without ROS.

A ``ScanRequest`` becomes a ``Plan`` of sweeps; ``run_job`` executes it through the protocol
``Tools`` and drives the ``StateMachine``. The folder of a scan holds its state and its report.
"""

from ivfmc_ros.scan.job import Outcome as Outcome
from ivfmc_ros.scan.job import run_job as run_job
from ivfmc_ros.scan.job import Tools as Tools
from ivfmc_ros.scan.plan import make_plan as make_plan
from ivfmc_ros.scan.plan import MotionLimits as MotionLimits
from ivfmc_ros.scan.plan import Plan as Plan
from ivfmc_ros.scan.plan import Sweep as Sweep
from ivfmc_ros.scan.request import ScanRequest as ScanRequest
from ivfmc_ros.scan.state_machine import Stage as Stage
from ivfmc_ros.scan.state_machine import StateMachine as StateMachine
