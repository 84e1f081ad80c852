# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Throughput of the live graph: the highest image rate without loss, and its latency."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextlib import nullcontext
from dataclasses import dataclass
from dataclasses import replace
from pathlib import Path
import shutil
import subprocess
import sys
import tempfile
import time
from typing import Any

import numpy as np
from sensor_msgs.msg import PointCloud2
from support.graph_rig import Client
from support.graph_rig import node_environment
from support.graph_rig import running

from bench import at_least
from bench import Number
from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.nodes.convert.clouds import to_structured_array
from ivfmc_ros.nodes.convert.stamps import nanoseconds
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.solids import demo_part
from ivfmc_ros.simulation.render.renderer import simulate_scan
from ivfmc_ros.storage.bag.reader import open_bag

PROCESSES = Path(__file__).with_name('graph_processes.py')
# images per second; the rates after the first one that loses something are left out
RATES = (30, 60, 80, 100, 120, 150, 200, 250, 300)
SECONDS = 5.0
FRAMES = 24
EXPOSURE_S = 0.005
# Upper limit of the latency, ms, of the last images of a trial; above it a queue is growing.
MAX_FINAL_LATENCY_MS = 250.0


@dataclass(frozen=True)
class Trial:
    """Result of one run at one image rate: images sent, profiles received, latency of each."""

    rate: float
    sent: int
    elapsed: float
    got: int
    gaps: int
    latency_ms: Any
    in_bag: tuple[int, int] | None = None

    @property
    def complete(self) -> bool:
        """Whether every image became a profile (and is in the bag), and no queue grew."""
        whole = self.got == self.sent and not self.gaps
        recorded = self.in_bag in (None, (self.sent, self.sent))
        return whole and recorded and np.median(self.latency_ms[-FRAMES:]) < MAX_FINAL_LATENCY_MS

    @property
    def achieved(self) -> float:
        return self.sent / self.elapsed

    def __str__(self) -> str:
        median, late = (np.percentile(self.latency_ms, q) for q in (50, 99))
        return (
            f'asked {self.rate:g}/s, sent {self.achieved:.1f}/s, {self.got} of {self.sent} '
            f'profiles, {self.gaps} gaps, latency {median:.1f} ms, 99 %: {late:.1f} ms'
            + (f', in the bag {self.in_bag}' if self.in_bag else '')
        )


def run() -> Iterator[Number]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        cell = bench_cell()
        save_cell(folder / 'cell.yaml', cell)
        frames = simulate_scan(cell, demo_part(), FRAMES, lasers=[0])
        np.save(folder / 'frames.npy', np.stack([frame.image for frame in frames]))
        yield from bare(folder)
        yield from recorder_off(folder)
        yield from recorder_on(folder)


def bare(folder: Path) -> Iterator[Number]:
    """Measure the rate that a Python subscriber without any work receives from a Python camera."""
    achieved = 0.0
    for rate in RATES:
        with (
            started('listener') as listener,
            started('source', folder / 'frames.npy', 'still') as source,
        ):
            sent, elapsed = request_images(source, rate, SECONDS)
            got = int(listener.stdout.readline())
        print(f'bare: asked {rate}/s, sent {sent / elapsed:.1f}/s, {got} of {sent} pictures')
        if got < sent:
            break
        achieved = max(achieved, sent / elapsed)
    BEST['bare'] = achieved
    yield Number(
        'bare_subscriber', achieved, 'frames/s', None, 'a Python subscriber that only counts'
    )


def recorder_off(folder: Path) -> Iterator[Number]:
    trials = triangulated(folder)
    achieved = best(trials)
    yield Number('triangulator', achieved, 'frames/s', at_least(60.0), 'no profile missing')
    share = achieved / BEST['bare'] if BEST['bare'] else 0.0
    yield Number('share_of_bare', share, '', at_least(0.5), 'of what a bare subscriber reaches')
    yield from latencies('latency', trials)


def recorder_on(folder: Path) -> Iterator[Number]:
    trials = triangulated(folder, recorded=True)
    note = 'no profile missing, all pictures and profiles in the bag'
    yield Number('with_recorder', best(trials), 'frames/s', at_least(30.0), note)
    yield from latencies('latency_with_recorder', trials)


def best(trials: list[Trial]) -> float:
    return max((trial.achieved for trial in trials if trial.complete), default=0.0)


def latencies(name: str, trials: list[Trial]) -> Iterator[Number]:
    """Report the latency of the fastest trial up to 60 images per second that lost nothing."""
    steady = [trial for trial in trials if trial.complete and trial.rate <= 60]
    for trial in steady[-1:]:
        note = f'stamp to profile at {trial.rate:g} frames/s, lasers reported at 10 Hz'
        for suffix, percent in (('median', 50), ('p99', 99)):
            value = float(np.percentile(trial.latency_ms, percent))
            yield Number(f'{name}_{suffix}', value, 'ms', None, note)


BEST: dict[str, float] = {}


def triangulated(folder: Path, recorded: bool = False) -> list[Trial]:
    """Run trials at rising rates, up to the first that loses something."""
    parameters = {'cell': str(folder / 'cell.yaml'), 'exposure': EXPOSURE_S}
    trials: list[Trial] = []
    client = Client()
    try:
        profiles = client.collect(PointCloud2, 'profile')
        with (
            running('triangulator', **parameters),
            running('recorder', scan_root=str(folder)) if recorded else nullcontext(),
            started('source', folder / 'frames.npy', 'turning') as source,
        ):
            # the recorder subscribes when it starts
            client.until(lambda: client.node.count_subscribers('image_raw'), 20.0)
            # discovery, and the subscription's adaptation to its publisher
            client.spin(2.0)
            for number, rate in enumerate(RATES):
                assert client.set('triangulator', scan_id=f'trial {number}').successful
                if recorded:
                    done = recorded_trial(client, source, profiles, rate, folder / f'{number}')
                else:
                    done = trial(client, source, profiles, rate)
                print(done)
                trials.append(done)
                if not done.complete:
                    break
    finally:
        client.close()
    return trials


def recorded_trial(
    client: Client, source: Any, profiles: list[Any], rate: float, folder: Path
) -> Trial:
    folder.mkdir()
    assert client.set('recorder', scan_folder=str(folder), scan_id=folder.name).successful
    success, answer = client.trigger('recorder/start')
    assert success, answer
    done = trial(client, source, profiles, rate)
    success, answer = client.trigger('recorder/stop')
    assert success, answer
    topics = open_bag(folder).topics
    shutil.rmtree(folder)
    counts = [topics[f'/ivfmc/{name}'].count for name in ('image_raw', 'profile')]
    return replace(done, in_bag=(counts[0], counts[1]))


def trial(client: Client, source: Any, profiles: list[Any], rate: float) -> Trial:
    profiles.clear()
    latency, seqs = [], []
    source.stdin.write(f'{rate} {SECONDS}\n')
    source.stdin.flush()
    begin = time.monotonic()
    done, quiet = 0, begin
    while time.monotonic() < begin + SECONDS + 2.0 or time.monotonic() < quiet + 1.0:
        client.executor.spin_once(timeout_sec=0.05)
        for message in profiles[done:]:
            latency.append((time.time_ns() - nanoseconds(message.header.stamp)) * 1e-6)
            seqs.append(int(to_structured_array(message, '', ('seq',))['seq'][0, 0]))
            quiet = time.monotonic()
        done = len(profiles)
    sent, elapsed = source.stdout.readline().split()
    gaps = int(np.count_nonzero(np.diff(seqs) != 1)) + (seqs[:1] != [0])
    return Trial(rate, int(sent), float(elapsed), len(seqs), gaps, np.array(latency or [np.nan]))


@contextmanager
def started(kind: str, *arguments: Any) -> Iterator[Any]:
    process = subprocess.Popen(
        [sys.executable, str(PROCESSES), kind, *map(str, arguments)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=node_environment(),
    )
    try:
        assert process.stdout.readline() == 'ready\n'
        time.sleep(1.0)
        yield process
    finally:
        process.stdin.close()
        process.terminate()
        process.wait(10)


def request_images(source: Any, rate: float, seconds: float) -> tuple[int, float]:
    source.stdin.write(f'{rate} {seconds}\n')
    source.stdin.flush()
    sent, elapsed = source.stdout.readline().split()
    return int(sent), float(elapsed)
