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

from bench import at_most
from bench import Number
from bench.scan_steps import scan_steps
from ivfmc_ros.cli.support.cell_run import NODES
from ivfmc_ros.nodes.convert.stamps import nanoseconds
from ivfmc_ros.nodes.framework import qos

# Seconds until the workers have imported their libraries, and the triangulator rests.
SETTLE_S = 45.0
IDLE_S = 60.0
SCAN_S = 900.0
# A mesh as fine as the data; off by default.
DECIMATE_SIGMAS = 0.25
# Profiles of each of the two views: the demo, and a scan of about 500,000 points.
DEMO, LARGE = 200, 400


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
                yield from scanned(client, profiles, bar_s)
        finally:
            client.close()
            cell.end()


def idle(cell: Cell, client: Client) -> Iterator[Number]:
    """Processor seconds a second of each node, its worker process included."""
    groups = {name: _family(cell.id_of(name)) for name in NODES}
    # the client of this bench sleeps: its own subscriptions are part of no cell
    before = {name: _seconds(group) for name, group in groups.items()}
    start = time.monotonic()
    time.sleep(IDLE_S)
    elapsed = time.monotonic() - start
    shares = {name: (_seconds(group) - before[name]) / elapsed for name, group in groups.items()}
    for name, share in shares.items():
        yield Number(f'idle cell, {name}', share, 'of a core')
    note = f'processor time over {elapsed:.0f} s'
    yield Number('idle cell, seven nodes', sum(shares.values()), 'of a core', at_most(0.15), note)


def _family(pid: int) -> list[psutil.Process]:
    process = psutil.Process(pid)
    return [process, *process.children(recursive=True)]


def _seconds(group: list[psutil.Process]) -> float:
    return sum(times.user + times.system for times in (one.cpu_times() for one in group))


@dataclass
class Scan:
    """
    What a client saw of a scan; times are seconds of the wall clock, as of stamps and files.

    last_profile, answered : of the last profile, when its image was exposed; of the answer
    """

    answer: Mapping[str, Any]
    last_profile: float
    answered: float

    @property
    def mesh_on_disk(self) -> float:
        files = (Path(path) for path in self.answer['mesh']['paths'].values())
        return max(file.stat().st_mtime for file in files)


def scanned(client: Client, profiles: int, bar_s: float) -> Iterator[Number]:
    """Scan the demo part with both lasers in continuous motion."""
    scan = scan_demo(client, profiles)
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
    # the bar of 1.15 holds for a camera of 30 images/s, which the simulated one does not reach
    speeds = [abs(motion['speed']) for motion in answer['registration']['motions']]
    rate = sum(speeds) / len(speeds) * profiles / (2.0 * math.pi)
    share = answer['seconds']['scanning'] * rate / answer['counts']['profiles_planned']
    note = f'simulated camera, {rate:.1f} images/s'
    yield Number(f'{name}, scanning over images', share, '', None, note)


def scan_demo(client: Client, profiles: int) -> Scan:
    stamps: list[int] = []
    subscription = client.node.create_subscription(
        PointCloud2,
        'profile',
        lambda message: stamps.append(nanoseconds(message.header.stamp)),
        qos.of_topic('profile'),
    )
    values = {'part': 'bench', 'motion': 'continuous', 'profiles': profiles, 'lasers': ['']}
    assert client.set('orchestrator', **values).successful
    client.status.clear()
    success, started = client.trigger('start_scan')
    assert success, started

    def result() -> dict[str, Any]:
        found = {item.key: item.value for item in client.status[-1].values}
        if found['scan_id'] != started['scan_id']:
            return {}
        return dict(json.loads(found['result'] or '{}'))

    client.until(lambda: client.status and result(), SCAN_S, 'no end of the scan')
    answered = time.time()
    client.node.destroy_subscription(subscription)
    answer = result()
    assert answer['code'] == 'OK', answer
    return Scan(answer=answer, last_profile=max(stamps) * 1e-9, answered=answered)
