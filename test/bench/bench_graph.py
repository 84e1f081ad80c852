# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Live throughput: how many pictures a second become profiles, and how long that takes."""

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

PARTS = Path(__file__).with_name('graph_parts.py')
# pictures a second, up to the first at which something is lost
RATES = (30, 60, 80, 100, 120, 150, 200, 250, 300)
SECONDS = 5.0
FRAMES = 24
EXPOSURE_S = 0.005
# The last pictures of a trial are no older when they are profiles, where nothing piles up.
BEHIND_MS = 250.0


@dataclass(frozen=True)
class Trial:
    """What became of the pictures of one rate."""

    rate: float
    sent: int
    took: float
    got: int
    gaps: int
    latency_ms: Any
    in_bag: tuple[int, int] | None = None

    @property
    def complete(self) -> bool:
        """Whether every picture is a profile, in the bag if there is one, and none piled up."""
        whole = self.got == self.sent and not self.gaps
        recorded = self.in_bag in (None, (self.sent, self.sent))
        return whole and recorded and np.median(self.latency_ms[-FRAMES:]) < BEHIND_MS

    @property
    def reached(self) -> float:
        return self.sent / self.took

    def __str__(self) -> str:
        median, late = (np.percentile(self.latency_ms, q) for q in (50, 99))
        return (
            f'asked {self.rate:g}/s, sent {self.reached:.1f}/s, {self.got} of {self.sent} '
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
    """What a Python subscriber that does nothing takes in, of what a Python camera gives out."""
    reached = 0.0
    for rate in RATES:
        with (
            part('listener') as listener,
            part('source', folder / 'frames.npy', 'still') as source,
        ):
            sent, took = asked(source, rate, SECONDS)
            got = int(listener.stdout.readline())
        print(f'bare: asked {rate}/s, sent {sent / took:.1f}/s, {got} of {sent} pictures')
        if got < sent:
            break
        reached = max(reached, sent / took)
    BEST['bare'] = reached
    yield Number(
        'bare_subscriber', reached, 'frames/s', None, 'a Python subscriber that only counts'
    )


def recorder_off(folder: Path) -> Iterator[Number]:
    trials = triangulated(folder)
    reached = best(trials)
    yield Number('triangulator', reached, 'frames/s', at_least(60.0), 'no profile missing')
    share = reached / BEST['bare'] if BEST['bare'] else 0.0
    yield Number('share_of_bare', share, '', at_least(0.5), 'of what a bare subscriber reaches')
    yield from latencies('latency', trials)


def recorder_on(folder: Path) -> Iterator[Number]:
    trials = triangulated(folder, recorded=True)
    note = 'no profile missing, all pictures and profiles in the bag'
    yield Number('with_recorder', best(trials), 'frames/s', at_least(30.0), note)
    yield from latencies('latency_with_recorder', trials)


def best(trials: list[Trial]) -> float:
    return max((trial.reached for trial in trials if trial.complete), default=0.0)


def latencies(name: str, trials: list[Trial]) -> Iterator[Number]:
    """Of the fastest trial up to 60 pictures a second that lost nothing."""
    steady = [trial for trial in trials if trial.complete and trial.rate <= 60]
    for trial in steady[-1:]:
        note = f'stamp to profile at {trial.rate:g} frames/s, lasers reported at 10 Hz'
        for part, percent in (('median', 50), ('p99', 99)):
            value = float(np.percentile(trial.latency_ms, percent))
            yield Number(f'{name}_{part}', value, 'ms', None, note)


BEST: dict[str, float] = {}


def triangulated(folder: Path, recorded: bool = False) -> list[Trial]:
    """The trials at rising rates, up to the first that loses something."""
    parameters = {'cell': str(folder / 'cell.yaml'), 'exposure': EXPOSURE_S}
    trials: list[Trial] = []
    client = Client()
    try:
        profiles = client.collect(PointCloud2, 'profile')
        with (
            running('triangulator', **parameters),
            running('recorder', scan_root=str(folder)) if recorded else nullcontext(),
            part('source', folder / 'frames.npy', 'turning') as source,
        ):
            client.until(lambda: client.node.count_subscribers('image_raw') > recorded, 20.0)
            # to be found and to adapt takes a moment
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
    sent, took = source.stdout.readline().split()
    gaps = int(np.count_nonzero(np.diff(seqs) != 1)) + (seqs[:1] != [0])
    return Trial(rate, int(sent), float(took), len(seqs), gaps, np.array(latency or [np.nan]))


@contextmanager
def part(kind: str, *arguments: Any) -> Iterator[Any]:
    process = subprocess.Popen(
        [sys.executable, str(PARTS), kind, *map(str, arguments)],
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


def asked(source: Any, rate: float, seconds: float) -> tuple[int, float]:
    source.stdin.write(f'{rate} {seconds}\n')
    source.stdin.flush()
    sent, took = source.stdout.readline().split()
    return int(sent), float(took)
