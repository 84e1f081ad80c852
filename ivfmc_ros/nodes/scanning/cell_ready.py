# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Waits for the nodes of a cell that is starting, and says which of them a scan watches."""

from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import TimeoutExceededError
from ivfmc_ros.nodes.framework.futures import ServiceClients
from ivfmc_ros.nodes.scanning.cell_link import CellLink
from ivfmc_ros.nodes.scanning.cell_link import JOINTS
from ivfmc_ros.scan.state_machine import StateMachine

# Nodes that every scan needs.
NEEDED = ('triangulator', 'registrar', 'mesher', 'recorder')
# Nodes that foreign drivers without a heartbeat may replace; watched only where they run.
OPTIONAL = ('camera', 'turntable')

# Seconds that a cell whose nodes are starting may take.
_STARTUP_S = 15.0


async def wait_for_cell(
    services: ServiceClients, link: CellLink, machine: StateMachine
) -> list[str]:
    """
    Wait for a cell that is starting; return the names of the nodes to watch, and JOINTS.

    :raises HelperError: a node or the table is missing; the code names it
    """
    watch = link.watch
    needed = [*NEEDED, JOINTS]
    try:
        await services.waiter.until(
            lambda: not watch.lost(needed) and link.has_table(),
            _STARTUP_S,
            'the nodes of the cell',
            machine.raise_if_cancelled,
        )
    except TimeoutExceededError:
        link.diagnostics.require_ready()
        watch.require_alive(NEEDED)
        if not link.has_table():
            raise HelperError('TURNTABLE_LOST', 'joint_trajectory has no subscription') from None
        watch.require_alive([JOINTS])
    return needed + [name for name in OPTIONAL if not watch.lost([name])]
