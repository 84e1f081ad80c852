# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc calibrate``: camera, lasers and turntable, together or each from pictures."""

from pathlib import Path

import click

from ivfmc_ros.cli.calibrate.camera import camera
from ivfmc_ros.cli.calibrate.check import check
from ivfmc_ros.cli.calibrate.joint import calibrate_all
from ivfmc_ros.cli.calibrate.laser import laser
from ivfmc_ros.cli.calibrate.live import live
from ivfmc_ros.cli.calibrate.noise import noise
from ivfmc_ros.cli.calibrate.nominal import nominal
from ivfmc_ros.cli.calibrate.turntable import angles
from ivfmc_ros.cli.calibrate.turntable import turntable
from ivfmc_ros.cli.support.suggest import SuggestingGroup


class _CalibrateGroup(SuggestingGroup):
    """Takes a folder in place of a command for the command ``all``."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and self.get_command(ctx, args[0]) is None and Path(args[0]).is_dir():
            args = ['all', *args]
        return super().resolve_command(ctx, args)


@click.group(cls=_CalibrateGroup)
def calibrate() -> None:
    """
    Calibrate camera, lasers and turntable from pictures.

    With a folder in place of a command, or by the command all, everything together; or step by
    step in this order: camera, laser, turntable. Beside its YAML file each command writes a
    figure (.png) and a report (.report.json) of the result.
    """


for command in (calibrate_all, camera, laser, turntable, angles, nominal, noise, live, check):
    calibrate.add_command(command)
