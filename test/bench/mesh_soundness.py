# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bench of meshing: soundness on degraded views, and scaling with the number of points."""

from collections.abc import Iterator
import resource

import numpy as np
from support.degraded_views import CELL
from support.degraded_views import degrade
from support.degraded_views import mesh_defects
from support.degraded_views import views

from bench import at_least
from bench import at_most
from bench import Number
from bench.mesh_methods import bumpy_ball
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
    """A sphere, 40 profiles per laser, with noise, outliers and holes, closed and open."""
    clean = views(steps=40)
    for close in ('all', 'none'):
        settings = MeshSettings(close=close, floor=None, voxel=1.2e-3, island=50)
        unsound = {}
        for seed in range(seeds):
            degraded = [degrade(view, seed) for view in clean]
            mesh = build_mesh(CELL, degraded, Poses.identity(len(degraded)), settings)
            found = mesh_defects(mesh, closed=close == 'all')
            if found:
                unsound[seed] = found
        note = f'of {seeds}; ' + '; '.join(f'seed {k}: {", ".join(v)}' for k, v in unsound.items())
        yield Number(
            f'sound, close {close}', seeds - len(unsound), '', at_least(seeds), note.strip('; ')
        )


def scaling() -> Iterator[Number]:
    """Processor time from points to a mesh file, and peak memory of the largest run."""
    settings = MeshSettings(close='all', floor=None)
    took = []
    for count in COUNTS:
        # as many vertices as points: about 1.5 per face of a voxel
        voxel = float(np.sqrt(1.6 * 4 * np.pi * 0.03**2 / count))
        points = bumpy_ball(count)
        took.append(timed(lambda p=points, v=voxel: integrate(p, v, settings))[0])
    slope = np.polyfit(np.log(COUNTS), np.log([each.processor for each in took]), 1)[0]
    note = ', '.join(f'{n / 1e6:g} M {each}' for n, each in zip(COUNTS, took, strict=True))
    yield Number('exponent of the time', slope, '', at_most(1.15), note)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / COUNTS[-1]
    yield Number('peak memory per point', peak, 'byte', note='of the whole process, 10 M points')
