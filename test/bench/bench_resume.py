# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Resumed scans: the whole graph is killed by SIGKILL at random moments of a scan, and goes on.

IVFMC_RESUME_KILLS sets the number of kills (50): each takes about a minute and a half.
IVFMC_RESUME_SEED sets their moments.
"""

from collections.abc import Iterator
import os
from pathlib import Path
import random
import tempfile
from typing import Any

from support.graph_rig import following_client
from support.interrupted_cell import Interruption
from support.interrupted_cell import kill_in_scan
from support.interrupted_cell import mesh_distance
from support.interrupted_cell import resume
from support.interrupted_cell import stamps_of
from support.interrupted_cell import start_cell
from support.interrupted_cell import whole_scan

from bench import at_most
from bench import Number

KILLS = int(os.environ.get('IVFMC_RESUME_KILLS', '50'))
SEED = int(os.environ.get('IVFMC_RESUME_SEED', '20261128'))
# Profiles that are recorded when the kill is due, and seconds from then on: in both sweeps, and
# between two chunks of the bag.
FIRST, LAST, DELAY_S = 1, 80, 0.5
# Distance of two meshes of the same part by the same cell that is noise, meters.
NOISE_M = 1e-4


def run() -> Iterator[Number]:
    with tempfile.TemporaryDirectory() as name:
        yield from kills(Path(name), KILLS)


def kills(folder: Path, count: int) -> Iterator[Number]:
    """Kill the graph ``count`` times in a scan, and resume each scan."""
    rng = random.Random(SEED)
    found: list[tuple[Interruption, dict[str, Any], dict[int, int]]] = []
    with following_client() as client:
        cell = start_cell(client, folder)
        try:
            whole = whole_scan(client)
            assert whole['code'] == 'OK', whole
            for _ in range(count):
                profiles, delay_s = rng.randint(FIRST, LAST), rng.uniform(0.0, DELAY_S)
                interruption = kill_in_scan(client, cell, profiles, delay_s)
                cell = start_cell(client, folder)
                answer = resume(client, interruption.scan_id)
                after = stamps_of(cell.scans / interruption.scan_id)
                found.append((interruption, answer, after))
                print(f'resume: killed at {interruption.acknowledged}: {answer["code"]}')
        finally:
            cell.kill()
    yield from _rows(found, whole)


def _rows(
    found: list[tuple[Interruption, dict[str, Any], dict[int, int]]], whole: dict[str, Any]
) -> Iterator[Number]:
    count = len(found)
    good = [answer for _, answer, _ in found if answer['code'] == 'OK']
    acknowledged = sum(interruption.acknowledged for interruption, _, _ in found)
    lost = sum(
        len(set(range(one.acknowledged)) - one.stamps_ns.keys())
        + len(one.stamps_ns.items() - after.items())
        for one, _, after in found
    )
    note = f'kill -9 of the whole graph at {count} random moments of a scan'
    yield Number('kill -9, scans not resumed', count - len(good), 'scans', at_most(0), note)
    note = f'of {acknowledged} acknowledged ones'
    yield Number('kill -9, profiles missing', lost, 'profiles', at_most(0), note)
    distances = [mesh_distance(answer, whole) for answer in good]
    worst = max(distances, default=float('nan')) * 1e3
    note = f'greatest of {len(good)} robust rms distances; noise is {NOISE_M * 1e3:g} mm'
    name = 'resumed mesh against uninterrupted one'
    yield Number(name, worst, 'mm', at_most(NOISE_M * 1e3), note)
    taken = [answer['counts']['profiles'] for answer in good]
    excess = max(taken, default=0) / whole['counts']['profiles']
    yield Number('resumed, profiles over those of a whole scan', excess, '', None)
