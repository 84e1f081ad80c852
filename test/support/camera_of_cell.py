# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Runs ``ivfmc`` with another simulated camera."""

import sys

from ivfmc_ros.cli import main as cli
from ivfmc_ros.cli.support import cell_run
from ivfmc_ros.nodes import camera as camera_node
from ivfmc_ros.simulation.live import camera as live_camera

NODE = 'ivfmc_ros.nodes.camera'


def run_with_camera(camera: type[live_camera.SimulatedCamera], module: str) -> int:
    """
    Run the command ``ivfmc`` or, named as the first argument, its camera node.

    module : that calls this function as its main one, and is started for the camera node
    """
    if sys.argv[1] == NODE:
        live_camera.SimulatedCamera = camera
        del sys.argv[1]
        return camera_node.main()
    plain = cell_run.command

    def command(run: cell_run.CellRun, node: str) -> list[str]:
        words = plain(run, node)
        if node == 'camera':
            words.insert(words.index(NODE), module)
        return words

    cell_run.command = command
    cli.main()
    return 0
