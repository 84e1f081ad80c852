# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc calibrate``: camera, lasers and turntable, each from pictures."""

import click

from ivfmc_ros.cli.calibrate.camera import camera
from ivfmc_ros.cli.calibrate.laser import laser
from ivfmc_ros.cli.calibrate.noise import noise
from ivfmc_ros.cli.calibrate.nominal import nominal
from ivfmc_ros.cli.calibrate.turntable import angles
from ivfmc_ros.cli.calibrate.turntable import turntable
from ivfmc_ros.cli.support.suggest import SuggestingGroup


@click.group(cls=SuggestingGroup)
def calibrate() -> None:
    """
    Calibrate camera, lasers and turntable from pictures.

    Run them in this order: camera, laser, turntable. Beside its YAML file each command writes a
    figure (.png) and a report (.report.json) of the result.
    """


for command in (camera, laser, turntable, angles, nominal, noise):
    calibrate.add_command(command)
