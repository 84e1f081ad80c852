# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kills processes of a cell in a sweep with the beam on, and measures when the beam is off."""

from collections.abc import Iterator
import contextlib
from contextlib import contextmanager
import math
from pathlib import Path
import signal
import subprocess
import sys
import tempfile
import time

from ivfmc_ros.simulation.live.folder import LiveFolder
from support.fault_cell import FaultCell
from support.fault_cell import FaultClient
from support.fault_effects import repair
from support.fault_effects import SHORT
from support.fault_effects import start
from support.graph_rig import node_environment
from support.small_cell import small_cell_options

# What is killed, by the title of the row. The emulated controller goes on, and so does the guard
# of the beam, which is there for this.
KILLED_PARTS = {
    'orchestrator': 'the orchestrator; ivfmc up and all other nodes go on',
    'whole graph': 'every node and ivfmc up, at once; not the guard of the beam',
}
# Seconds until the beam shines in a scan (only a failure takes so long, on a busy machine), and
# after which it has stayed on; the keep-alive ends after 0.5 s, and a moving table brakes first.
_LIT_S, _OFF_S = 120.0, 5.0
# A table that turns is faster than this, rad/s.
_TURNS = 0.15


class KillCell(FaultCell):
    """A cell whose simulated hardware runs beside ``ivfmc up``, and outlives it."""

    def __init__(self, client: FaultClient, folder: Path) -> None:
        super().__init__(client, folder)
        self._live = LiveFolder(folder / 'live')
        words = [sys.executable, '-m', 'ivfmc_ros.simulation.live_cell', '--folder']
        # without --simulate
        files = small_cell_options(folder)[1:]
        self._hardware = subprocess.Popen(
            [*words, str(self._live.folder), *files, '--part', 'demo'],
            env=node_environment(),
            stdout=subprocess.PIPE,
        )
        assert self._hardware.stdout is not None
        assert self._hardware.stdout.readline() == b'ready\n'

    @property
    def live_folder(self) -> LiveFolder:
        return self._live

    def options(self) -> list[str]:
        folder = self._live.folder
        settings = {
            'turntable.port': self._live.controller,
            'camera.backend': 'simulated',
            'camera.simulation': folder,
        }
        files = ['--cell', str(folder / 'cell.yaml'), '--camera', str(folder / 'camera.yaml')]
        return files + [
            word for key, value in settings.items() for word in ('--set', f'{key}={value}')
        ]

    def close(self) -> None:
        """Kill the cell, and end its hardware."""
        self.kill()
        self._hardware.terminate()
        self._hardware.wait(10.0)


@contextmanager
def cell_for_kills() -> Iterator[KillCell]:
    """Yield a cell of real processes."""
    client = FaultClient()
    try:
        with tempfile.TemporaryDirectory() as folder:
            cell = KillCell(client, Path(folder))
            try:
                yield cell
            finally:
                cell.close()
    finally:
        client.close()


def beam_off_after_kill(cell: FaultCell, part: str, number: signal.Signals) -> float:
    """
    Begin a scan, kill, and restore the cell.

    :returns: seconds from the signal until the beam was off for good; inf where it stayed on, NaN
        where it did not shine
    """
    cell.ensure()
    # a controller that was reset in a motion is locked
    repair(cell, plug=False)
    cell.find_processes()
    scan_id = start(cell, SHORT)

    def sweeping() -> bool:
        return cell.lit() and cell.table_speed() > _TURNS

    cell.client.wait(lambda: sweeping() or cell.client.result(scan_id), _LIT_S)
    if not sweeping():
        cell.kill()
        return math.nan
    begin_s = time.monotonic()
    if part == 'orchestrator':
        cell.signal(part, number)
    else:
        cell.signal_all(number)
    while cell.lit() and time.monotonic() - begin_s < _OFF_S:
        time.sleep(0.005)
    # it must not come back: a node that is started again may not light it
    time.sleep(0.5)
    seconds = cell.beam_off_after(begin_s)
    if part == 'orchestrator':
        # ivfmc up starts it again, and has killed one that hung
        with contextlib.suppress(ProcessLookupError):
            cell.signal(part, signal.SIGKILL)
    else:
        cell.kill()
    return seconds
