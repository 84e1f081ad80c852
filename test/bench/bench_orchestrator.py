# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Bench of a whole cell, started by ``ivfmc up --simulate``: what a cell controller waits for.

The time from the last profile to the mesh on disk and to the answer, the processor share of the
idle cell, and the duration of a continuous scan over that of its images. For an idle computer.
"""

from collections.abc import Iterator
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
import json
import math
from pathlib import Path
import tempfile
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
import psutil
from sensor_msgs.msg import PointCloud2
from support.cell_rig import Cell
from support.graph_rig import Client
from support.prerendered_camera import PICTURES
from support.prerendered_camera import PrerenderedCell
from support.prerendered_camera import write_pictures

from bench import at_most
from bench import Number
from bench.loaded_scans import loaded_scans
from bench.pool import mapped
from bench.scan_steps import scan_steps
from ivfmc_ros.cli.support.cell_run import NODES
from ivfmc_ros.nodes.convert.stamps import nanoseconds
from ivfmc_ros.nodes.framework import qos
from ivfmc_ros.simulation.bench import bench_cell

# Seconds until the workers have imported their libraries, and the triangulator rests.
SETTLE_S = 45.0
IDLE_S = 60.0
# Seconds in which a triangulator that does not rest has another image.
_REST_S = 5.0
SCAN_S = 900.0
# A mesh as fine as the data; off by default.
DECIMATE_SIGMAS = 0.25
# Profiles of each of the two views: the demo, and a scan of about 500,000 points.
DEMO, LARGE = 200, 400
# Pictures a second of a camera that does not render them.
FRAME_RATE = 30.0


def run() -> Iterator[Number]:
    yield from scan_steps()
    with tempfile.TemporaryDirectory() as name:
        cell = Cell(
            Path(name),
            '--simulate',
            '--set',
            'triangulator.volume.bottom=0.0005',
            '--set',
            f'mesher.mesh.decimate_sigmas={DECIMATE_SIGMAS}',
        )
        client = Client()
        client.status = client.collect(DiagnosticStatus, 'scan_status')
        try:
            client.until(lambda: client.status, 120.0, 'no scan_status')
            client.spin(SETTLE_S)
            yield from idle(cell, client)
            for profiles, bar_s in ((DEMO, 2.0), (LARGE, 3.0)):
                yield from scanned(cell, client, profiles, bar_s)
        finally:
            client.close()
            cell.end()
    yield from full_rate()
    yield from loaded_scans()


def full_rate() -> Iterator[Number]:
    """Duration of a scan of two lasers over that of its pictures, 30 a second."""
    with tempfile.TemporaryDirectory() as name:
        pictures = Path(name) / 'pictures'
        pictures.mkdir()
        model = bench_cell()
        mapped(partial(write_pictures, pictures, model, LARGE), range(len(model.lasers)))
        cell = PrerenderedCell(
            Path(name) / 'run',
            *('--simulate', '--set', f'camera.frame_rate={FRAME_RATE}'),
            **{PICTURES: str(pictures)},
        )
        client = Client()
        client.status = client.collect(DiagnosticStatus, 'scan_status')
        try:
            client.until(lambda: client.status, 120.0, 'no scan_status')
            client.spin(SETTLE_S)
            answer = scan_demo(cell, client, LARGE, profile_rate=FRAME_RATE).answer
            planned = answer['counts']['profiles_planned']
            seconds = answer['seconds']['scanning']
            note = f'{seconds:.1f} s of scanning, {planned} pictures at {FRAME_RATE:g} 1/s'
            share = seconds * FRAME_RATE / planned
            row = f'{LARGE} profiles a view, full rate, scanning over images'
            yield Number(row, share, '', at_most(1.15), note)
        finally:
            client.close()
            cell.end()


def idle(cell: Cell, client: Client) -> Iterator[Number]:
    """Processor seconds a second of each node, its worker process included."""
    # nodes that start later than the orchestrator rest later
    seen = ''
    while (found := client.diagnostic('triangulator')) != seen:
        seen = found
        client.spin(_REST_S)
    shares = Shares(cell)
    # the client of this bench sleeps: its own subscriptions are part of no cell
    time.sleep(IDLE_S)
    used = shares.until_now()
    for name, share in used.items():
        yield Number(f'idle cell, {name}', share, 'of a core')
    total = sum(used[name] for name in NODES)
    note = f'processor time over {IDLE_S:.0f} s'
    yield Number('idle cell, seven nodes', total, 'of a core', at_most(0.15), note)


class Shares:
    """Processor time of the processes of a cell from now on."""

    def __init__(self, cell: Cell) -> None:
        self._ids = {name: cell.id_of(name) for name in NODES}
        self._ids['ivfmc up'] = cell.up.pid
        self._before, self._begin = self._seconds(), time.monotonic()

    def until_now(self) -> dict[str, float]:
        """Return the share of a core by node, and that of ``ivfmc up``."""
        elapsed = time.monotonic() - self._begin
        return {
            name: (seconds - self._before[name]) / elapsed
            for name, seconds in self._seconds().items()
        }

    def _seconds(self) -> dict[str, float]:
        return {name: _seconds(pid, name in NODES) for name, pid in self._ids.items()}


def _seconds(pid: int, with_children: bool) -> float:
    process = psutil.Process(pid)
    group = [process, *(process.children(recursive=True) if with_children else ())]
    return sum(times.user + times.system for times in (one.cpu_times() for one in group))


@dataclass
class Scan:
    """
    What a client saw of a scan; times are seconds of the wall clock, as of stamps and files.

    last_profile, answered : of the last profile, when its image was exposed; of the answer
    shares : of a core by node, while the profiles were taken
    """

    answer: Mapping[str, Any]
    last_profile: float
    answered: float
    shares: Mapping[str, float]

    @property
    def mesh_on_disk(self) -> float:
        files = (Path(path) for path in self.answer['mesh']['paths'].values())
        return max(file.stat().st_mtime for file in files)


def scanned(cell: Cell, client: Client, profiles: int, bar_s: float) -> Iterator[Number]:
    """Scan the demo part with both lasers in continuous motion."""
    scan = scan_demo(cell, client, profiles)
    answer = scan.answer
    points, faces = answer['counts']['points'], answer['mesh']['counts']['faces']
    name = f'{profiles} profiles a view'
    seconds = ', '.join(f'{key} {value:.1f}' for key, value in answer['seconds'].items())
    note = f'{points} points, {faces} faces; {seconds} s'
    waited = scan.mesh_on_disk - scan.last_profile
    yield Number(f'{name}, last profile to mesh on disk', waited, 's', at_most(bar_s), note)
    yield Number(
        f'{name}, mesh on disk to answer', scan.answered - scan.mesh_on_disk, 's', at_most(0.5)
    )
    yield Number(f'{name}, faces a point', faces / points, '', at_most(2.0))
    deviation = answer['mesh']['surface']['decimation_deviation_m']
    yield Number(f'{name}, deviation of the decimation', deviation * 1e3, 'mm')
    # the bar holds for a camera of 30 images/s, see ``full_rate``
    speeds = [abs(motion['speed']) for motion in answer['registration']['motions']]
    rate = sum(speeds) / len(speeds) * profiles / (2.0 * math.pi)
    share = answer['seconds']['scanning'] * rate / answer['counts']['profiles_planned']
    note = f'simulated camera, {rate:.1f} images/s'
    yield Number(f'{name}, scanning over images', share, '', None, note)
    for node, share in scan.shares.items():
        yield Number(f'{name}, scanning, {node}', share, 'of a core')


def scan_demo(cell: Cell, client: Client, profiles: int, **settings: Any) -> Scan:
    stamps: list[int] = []
    subscription = client.node.create_subscription(
        PointCloud2,
        'profile',
        lambda message: stamps.append(nanoseconds(message.header.stamp)),
        qos.of_topic('profile'),
    )
    values = {'part': 'bench', 'motion': 'continuous', 'profiles': profiles, 'lasers': ['']}
    values |= settings
    assert client.set('orchestrator', **values).successful
    client.status.clear()
    success, started = client.trigger('start_scan')
    assert success, started

    def status(key: str) -> str:
        values = client.status[-1].values if client.status else ()
        found = {item.key: item.value for item in values}
        return str(found.get(key, '')) if found.get('scan_id') == started['scan_id'] else ''

    client.until(lambda: status('stage') == 'SCANNING', SCAN_S, 'the scan does not begin')
    measured = Shares(cell)
    client.until(lambda: status('stage') != 'SCANNING', SCAN_S, 'no end of the profiles')
    shares = measured.until_now()
    client.until(lambda: status('result'), SCAN_S, 'no end of the scan')
    answered = time.time()
    client.node.destroy_subscription(subscription)
    answer: dict[str, Any] = json.loads(status('result'))
    assert answer['code'] == 'OK', answer
    return Scan(answer=answer, last_profile=max(stamps) * 1e-9, answered=answered, shares=shares)
