# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bench from images to a mesh: rendered images against CAD, a real scan against a box."""

from collections.abc import Iterator
import math
from pathlib import Path
import tempfile
import time

import numpy as np
from support.box_fit import fit_box
from support.real_scan import data_folder
from support.real_scan import measured_scan
from support.real_scan import run_documented_commands
import trimesh

from bench import at_least
from bench import at_most
from bench import mesh_methods
from bench import mesh_soundness
from bench import Number
from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.inspection.deviation import Deviation
from ivfmc_ros.inspection.deviation import summarize
from ivfmc_ros.pipeline import reconstruct
from ivfmc_ros.pipeline import Settings
from ivfmc_ros.results import merged_cloud
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.solids import demo_part
from ivfmc_ros.simulation.render.optics import Optics
from ivfmc_ros.simulation.render.renderer import simulate_scan
from ivfmc_ros.stripe.acquisition import AcquisitionSettings
from ivfmc_ros.stripe.extract import ExtractSettings
from ivfmc_ros.stripe.noise import SensorNoise
from ivfmc_ros.surface import Surface

STEPS = 400
# the platter is visible in the images too
VOLUME = Volume(bottom=0.5e-3)


def run() -> Iterator[Number]:
    yield from rendered()
    yield from real()
    yield from mesh_methods.run()
    yield from mesh_soundness.run()


def rendered() -> Iterator[Number]:
    """Points of the demo part to CAD: bench cell, 400 steps, both lasers, true calibration."""
    full = scan_demo_part(Optics())
    note = f'{full.count} points, {STEPS} steps, 2 lasers'
    yield Number('demo part, points to CAD, rms', full.rms * 1e3, 'mm', at_most(0.05), note)
    yield Number('demo part, points to CAD, 95 %', full.p95 * 1e3, 'mm', at_most(0.10), note)
    clean = scan_demo_part(Optics(speckle=0.0))
    note = f'{clean.count} points, speckle off'
    yield Number('demo part without speckle, rms', clean.rms * 1e3, 'mm', at_most(0.02), note)


def scan_demo_part(optics: Optics) -> Deviation:
    cell, part = bench_cell(), demo_part()
    # the camera noise is known from calibration, or given as here
    extract = ExtractSettings(noise=SensorNoise(speckle=optics.speckle))
    settings = Settings(acquisition=AcquisitionSettings(volume=VOLUME, extract=extract))
    made = reconstruct(cell, simulate_scan(cell, part, STEPS, optics=optics, seed=1), settings)
    points, _ = merged_cloud(made)
    return summarize(Surface(part.vertices_xyz, part.faces).signed_distance(points))


def real() -> Iterator[Number]:
    """Angles and flatness of a real block, scanned by the commands of the documentation."""
    data = measured_scan()
    if data is None:
        note = f'not measured: no turntable_laser in {data_folder()}; IVFMC_DATA names its folder'
        yield Number('real scan, points kept', math.nan, '', at_least(40_000), note)
        return
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        seconds = run_documented_commands(data, Path(folder))
        total = time.perf_counter() - start
        after = seconds['import-images'] + seconds['reconstruct']
        mesh = trimesh.load(Path(folder) / 'result' / 'mesh.ply', process=False)
        kept = len(trimesh.load(Path(folder) / 'result' / 'cloud.ply').vertices)
    box = fit_box(np.asarray(mesh.vertices), np.asarray(mesh.vertex_normals), 5.0, 32.0)
    note = f'whole sequence with calibration {total:.0f} s'
    yield Number('real scan, after calibration', after, 's', at_most(30.0), note)
    yield Number('real scan, points kept', kept, '', at_least(40_000))
    worst = float(np.abs(box.corners - 90.0).max())
    note = f'corners {np.round(box.corners, 2).tolist()} degrees'
    yield Number('block, corners off 90 degrees', worst, 'deg', at_most(0.6), note)
    note = f'pairs {np.round(box.skew, 2).tolist()}'
    yield Number('block, opposite sides', float(box.skew.max()), 'deg', at_most(1.0), note)
    note = f'sides {np.round(box.flatness, 3).tolist()}'
    yield Number('block, flatness, rms', float(box.flatness.max()), 'mm', at_most(0.30), note)
