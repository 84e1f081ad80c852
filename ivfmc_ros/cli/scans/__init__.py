# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc scans``: the scans of a cell or a plant: find, check, repair, exchange, delete."""

import click

from ivfmc_ros.cli.scans.care import rebuild
from ivfmc_ros.cli.scans.care import repair
from ivfmc_ros.cli.scans.care import verify
from ivfmc_ros.cli.scans.exchange import export
from ivfmc_ros.cli.scans.exchange import import_packages
from ivfmc_ros.cli.scans.exchange import report
from ivfmc_ros.cli.scans.listing import list_scans
from ivfmc_ros.cli.scans.listing import show
from ivfmc_ros.cli.scans.removal import delete
from ivfmc_ros.cli.scans.removal import empty_trash
from ivfmc_ros.cli.scans.removal import restore
from ivfmc_ros.cli.scans.statistics import statistics
from ivfmc_ros.cli.support.suggest import SuggestingGroup


@click.group(cls=SuggestingGroup)
def scans() -> None:
    """Find, check, repair, exchange and delete the scans of a cell or a plant."""


for _command in (
    delete,
    empty_trash,
    export,
    import_packages,
    list_scans,
    rebuild,
    repair,
    report,
    restore,
    show,
    statistics,
    verify,
):
    scans.add_command(_command)
