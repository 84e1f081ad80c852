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


@click.group()
def calibrate() -> None:
    """
    Calibrate camera, lasers and turntable from pictures.

    In this order: camera, then laser, then turntable. Beside its YAML file each writes a picture
    of what was found (.png) and a report (.report.json).
    """


for command in (camera, laser, turntable, angles, nominal, noise):
    calibrate.add_command(command)
