# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A long recording of raw pictures; time and memory of processes that measure its profiles."""

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
import time

import numpy as np

from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.solids import demo_part
from ivfmc_ros.simulation.render.renderer import simulate_scan
from ivfmc_ros.storage.bag.writer import create_bag

START = 1_700_000_000_000_000_000
# Different pictures; rendering all of them would take longer than the measurement.
_RENDERED = 24


def write_scan(folder: Path, count: int, shape: tuple[int, int]) -> None:
    cell = bench_cell()
    if (cell.camera.height, cell.camera.width) != shape:
        raise ValueError(f'the bench cell has other pictures than {shape}')
    frames = list(simulate_scan(cell, demo_part(), _RENDERED, lasers=[0]))
    with create_bag(folder / 'bag', compress=False) as bag:
        for number in range(count):
            stamp = START + number * 20_000_000
            bag.joint_state(stamp, cell.turntable.joint, 2.0 * np.pi * number / count)
            bag.laser_state(stamp - 10_000_000, {cell.lasers[0].name: True})
            bag.camera_info(stamp, cell.camera)
            bag.image(stamp, frames[number * _RENDERED // count].image)
    save_cell(folder / 'bag' / 'cell.yaml', cell)


def measure(folder: Path, jobs: int) -> tuple[float, float]:
    """
    Measure the bag in so many processes, each once.

    :returns: seconds until all have done so, and the peak memory of the largest process, MiB
    """
    with ProcessPoolExecutor(jobs, mp_context=get_context('spawn')) as pool:
        # the imports are not measured
        list(pool.map(_warm, [folder] * jobs))
        begin = time.perf_counter()
        peaks = list(pool.map(_profiles, [folder] * jobs))
        return time.perf_counter() - begin, max(peaks)


def _warm(folder: Path) -> None:
    from ivfmc_ros import pipeline

    time.sleep(0.5)
    if not folder.exists() or not hasattr(pipeline, 'measure_profiles'):
        raise FileNotFoundError(folder)


def _profiles(folder: Path) -> float:
    """Measure the profiles of a bag, and return the peak memory of this process, MiB."""
    from ivfmc_ros.cli.support.source import BagOptions
    from ivfmc_ros.cli.support.source import read_scan
    from ivfmc_ros.pipeline import measure_profiles
    from ivfmc_ros.pipeline import Settings
    from ivfmc_ros.stripe.opencv_threads import use_one_thread

    use_one_thread()
    scan, cell = read_scan(folder / 'bag', None, None, BagOptions())
    measure_profiles(cell, scan.frames(), Settings())
    return _peak_memory()


def _peak_memory() -> float:
    """Return that of this process, MiB; ru_maxrss is that of its parent where it was larger."""
    lines = Path('/proc/self/status').read_text(encoding='ascii').splitlines()
    [peak] = [line.split()[1] for line in lines if line.startswith('VmHWM:')]
    return int(peak) / 1024.0
