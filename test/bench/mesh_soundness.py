# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Meshing of what is spoilt, and of very many points."""

from collections.abc import Iterator
import resource

import numpy as np
from support.spoilt import CELL
from support.spoilt import spoilt
from support.spoilt import unsound
from support.spoilt import views

from bench import at_least
from bench import at_most
from bench import Number
from bench.mesh_methods import ball
from bench.mesh_methods import timed
from ivfmc_ros.meshing.build import build_mesh
from ivfmc_ros.meshing.integrate import integrate
from ivfmc_ros.meshing.settings import MeshSettings
from ivfmc_ros.model import Poses

SEEDS = 50
COUNTS = (1_000_000, 3_000_000, 10_000_000)


def run() -> Iterator[Number]:
    yield from soundness()
    yield from scaling()


def soundness(seeds: int = SEEDS) -> Iterator[Number]:
    """A sphere of 40 profiles a laser with noise, flying points and holes, closed and open."""
    clean = views(steps=40)
    for close in ('all', 'none'):
        settings = MeshSettings(close=close, floor=None, voxel=1.2e-3, island=50)
        wrong = {}
        for seed in range(seeds):
            bad = [spoilt(view, seed) for view in clean]
            mesh = build_mesh(CELL, bad, Poses.identity(len(bad)), settings)
            found = unsound(mesh, closed=close == 'all')
            if found:
                wrong[seed] = found
        note = f'of {seeds}; ' + '; '.join(f'seed {k}: {", ".join(v)}' for k, v in wrong.items())
        yield Number(
            f'sound, close {close}', seeds - len(wrong), '', at_least(seeds), note.strip('; ')
        )


def scaling() -> Iterator[Number]:
    """Processor time from points to a closed mesh on disk, and the memory of the largest."""
    settings = MeshSettings(close='all', floor=None)
    took = []
    for count in COUNTS:
        # as many vertices as points: about 1.5 a voxel's face
        voxel = float(np.sqrt(1.6 * 4 * np.pi * 0.03**2 / count))
        points = ball(count)
        took.append(timed(lambda p=points, v=voxel: integrate(p, v, settings))[0])
    slope = np.polyfit(np.log(COUNTS), np.log([each.processor for each in took]), 1)[0]
    note = ', '.join(f'{n / 1e6:g} M {each}' for n, each in zip(COUNTS, took, strict=True))
    yield Number('exponent of the time', slope, '', at_most(1.15), note)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / COUNTS[-1]
    yield Number('peak memory per point', peak, 'byte', note='of the whole process, 10 M points')
