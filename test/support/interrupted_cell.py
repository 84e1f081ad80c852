# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A simulated cell that is killed as a whole in a scan, started again, and resumes the scan."""

import contextlib
from dataclasses import dataclass
import json
import os
from pathlib import Path
import signal
from typing import Any

import numpy as np
from std_msgs.msg import UInt64

from ivfmc_ros.meshing.io.stl import read_stl
from ivfmc_ros.storage.recording.taken_profiles import read_taken_profiles
from ivfmc_ros.surface import Surface
from support.cell_rig import Cell
from support.graph_rig import Client

# A table with a home switch finds its zero again.
OPTIONS = (
    '--simulate',
    '--home-switch',
    '--set',
    'triangulator.volume.bottom=0.0005',
    '--set',
    'mesher.mesh.voxel=0.0006',
    # a busy computer loses neither node nor beam: what is tested is the kill
    '--set',
    'orchestrator.heartbeat_limit=15.0',
    '--set',
    'turntable.beam_hold_timeout=5.0',
)
# Of all scans that are compared.
PARAMETERS: dict[str, Any] = {
    'part': 'resumed',
    'motion': 'continuous',
    'profiles': 40,
    'profile_rate': 6.0,
    'lasers': ['left', 'right'],
    'home': True,
    'profile_patience': 120.0,
}
# Seconds; only a failing scan waits this long.
_START_S, _SCAN_S = 120.0, 400.0


@dataclass(frozen=True, kw_only=True)
class Interruption:
    """
    What a kill of the whole graph left.

    acknowledged : number of profiles that ``recorded`` had counted
    stamps_ns : of the profiles of the bag, by seq
    """

    scan_id: str
    acknowledged: int
    stamps_ns: dict[int, int]


def start_cell(client: Client, folder: Path) -> Cell:
    """Start the cell of a folder, which may have scans."""
    client.status.clear()
    client.forget('turntable')
    cell = Cell(folder, *OPTIONS)
    client.until(lambda: client.status, _START_S, cell.log())
    client.until(lambda: client.diagnostic('turntable'), _START_S, cell.log())
    return cell


def kill_in_scan(client: Client, cell: Cell, profiles: int, delay_s: float = 0.0) -> Interruption:
    """
    Start a scan, and kill every process of the cell in it.

    profiles, delay_s : number of recorded profiles at which the kill is due, and seconds from then
    """
    recorded = client.collect(UInt64, 'recorded')
    result = client.set('orchestrator', **PARAMETERS)
    assert result.successful, result.reason
    success, started = client.trigger('start_scan')
    assert success, started
    stages = ('SCANNING', 'REGISTERING', 'MESHING')
    client.until(lambda: values(client)['stage'] in stages, _START_S, cell.log())
    recorded.clear()
    client.until(
        lambda: (recorded and recorded[-1].data + 1 >= profiles) or values(client)['result'],
        _SCAN_S,
        cell.log(),
    )
    client.spin(delay_s)
    kill_all(cell)
    client.spin(0.2)
    folder = cell.scans / started['scan_id']
    return Interruption(
        scan_id=started['scan_id'],
        acknowledged=recorded[-1].data + 1,
        stamps_ns=stamps_of(folder),
    )


def kill_orchestrator(client: Client, cell: Cell, profiles: int) -> str:
    """Kill the orchestrator when so many profiles are recorded; ``up`` starts it again."""
    recorded = client.collect(UInt64, 'recorded')
    client.set('orchestrator', **PARAMETERS)
    scan_id = client.trigger('start_scan')[1]['scan_id']
    client.until(lambda: values(client)['stage'] == 'SCANNING', _START_S, cell.log())
    recorded.clear()
    client.until(lambda: recorded and recorded[-1].data + 1 >= profiles, _SCAN_S, cell.log())
    os.kill(cell.id_of('orchestrator'), signal.SIGKILL)
    client.status.clear()
    # of the new process: ``up`` has said the end in the name of the old one before
    client.until(
        lambda: cell.log().count('was interrupted and is marked FAILED') and client.status,
        _START_S,
        cell.log(),
    )
    return str(scan_id)


def kill_all(cell: Cell) -> None:
    """Send SIGKILL to every process of a cell at once, ``up`` included."""
    for pid in {cell.up.pid, *cell.processes()}:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    cell.kill()


def resume(client: Client, scan_id: str) -> dict[str, Any]:
    """Resume a scan, and return its answer."""
    client.set('orchestrator', resume_scan=scan_id)
    client.status.clear()
    success, answer = client.trigger('resume', _START_S)
    assert success, answer
    assert answer['resumed']
    return result_of(client, scan_id)


def whole_scan(client: Client) -> dict[str, Any]:
    """Take the same scan without an interruption."""
    client.set('orchestrator', **PARAMETERS)
    success, started = client.trigger('start_scan')
    assert success, started
    return result_of(client, started['scan_id'])


def result_of(client: Client, scan_id: str) -> dict[str, Any]:
    """Wait for the end of a scan, and return its answer."""

    def result() -> str:
        found = values(client) if client.status else {}
        return str(found.get('result', '')) if found.get('scan_id') == scan_id else ''

    client.until(lambda: bool(result()), _SCAN_S, f'no end of {scan_id}')
    return dict(json.loads(result()))


def values(client: Client) -> dict[str, str]:
    """Values of the last scan_status."""
    return {item.key: item.value for item in client.status[-1].values}


def stamps_of(folder: Path) -> dict[int, int]:
    """Stamps of the profiles of a bag, by seq."""
    taken = read_taken_profiles(folder)
    return {place.header.seq: place.header.stamp_ns for place in taken.locations}


def mesh_distance(answer: dict[str, Any], other: dict[str, Any]) -> float:
    """Robust rms distance of the vertices of a mesh to the surface of another, meters."""
    vertices, _ = read_stl(Path(answer['files']['mesh.stl']))
    surface = Surface(*read_stl(Path(other['files']['mesh.stl'])))
    return float(np.sqrt(np.median(surface.signed_distance(vertices) ** 2)))
