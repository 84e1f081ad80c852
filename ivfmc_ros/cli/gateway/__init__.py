# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc gateway``: the scan service for cell controllers that speak no ROS."""

import click

from ivfmc_ros.cli.gateway.http import http
from ivfmc_ros.cli.gateway.opcua import opcua
from ivfmc_ros.cli.support.suggest import SuggestingGroup


@click.group(cls=SuggestingGroup)
def gateway() -> None:
    """Serve the scan service of a cell by HTTP or OPC UA, for controllers that speak no ROS."""


for _command in (http, opcua):
    gateway.add_command(_command)
