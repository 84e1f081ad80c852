# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Processor seconds of each step from the last profile of a scan to its answer, without ROS."""

from collections.abc import Callable
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
import tempfile
import time
from typing import Any
from unittest import mock

from bench import Number
from ivfmc_ros import pipeline
from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.inspection.reports.scan_page import mesh_figures
from ivfmc_ros.meshing import build
from ivfmc_ros.meshing.filters.vertex_clustering import cluster_vertices
from ivfmc_ros.meshing.io import export
from ivfmc_ros.meshing.settings import MeshSettings
from ivfmc_ros.registration.misfit import laser_misfit
from ivfmc_ros.registration.slip import check_registration
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.solids import demo_part
from ivfmc_ros.simulation.render.optics import Optics
from ivfmc_ros.simulation.render.optics import with_sheet_thickness
from ivfmc_ros.simulation.render.renderer import simulate_scan
from ivfmc_ros.stripe.acquisition import AcquisitionSettings

STEPS = 200
DISPLAY_FACES = 50_000


class Steps:
    """Processor seconds by the name of a step; those of all threads."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        start = time.process_time()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.process_time() - start

    def wrapped(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def measured(*arguments: Any) -> Any:
            with self.step(name):
                return function(*arguments)

        return measured


def scan_steps() -> Iterator[Number]:
    """Demo part, 200 steps, two lasers: the default settings, decimated within sigma / 4."""
    cell = with_sheet_thickness(bench_cell(), Optics())
    settings = pipeline.Settings(
        acquisition=AcquisitionSettings(volume=Volume(bottom=0.5e-3)),
        mesh=MeshSettings(decimate_sigmas=0.25),
    )
    frames = simulate_scan(cell, demo_part(), STEPS, seed=3)
    profiles = pipeline.measure_profiles(cell, frames, settings)
    points = sum(len(profile) for profile in profiles)
    steps = Steps()
    with steps.step('views'):
        views, _, _ = pipeline.assemble_views(cell, profiles, settings)
    with steps.step('registration'):
        poses, verdicts = pipeline.register_views(views, settings)
    with steps.step('misfit of the lasers'):
        laser_misfit(views, poses)
    with steps.step('check for lost steps'):
        check_registration(views, poses, verdicts)
    inner = {
        'mesh: samples': 'sample_views',
        'mesh: signed distance and surface': 'integrate',
        'mesh: decimation': 'decimate',
    }
    with mock.patch.multiple(
        build, **{name: steps.wrapped(key, getattr(build, name)) for key, name in inner.items()}
    ):
        mesh, _ = pipeline.mesh_views(cell, views, poses, settings)
    with tempfile.TemporaryDirectory() as folder, steps.step('files'):
        for suffix in ('stl', 'ply'):
            export.write_mesh(Path(folder) / f'mesh.{suffix}', mesh, 'mm')
    with steps.step('mesh for display'):
        cluster_vertices(mesh.vertices_xyz, mesh.faces, DISPLAY_FACES)
    with steps.step('figures of the answer'):
        mesh_figures(mesh)
    for name, seconds in steps.seconds.items():
        yield Number(f'step, {name}', seconds, 's', None, 'processor time')
    note = f'{points} points, {len(mesh.faces)} faces'
    yield Number('steps, all', sum(steps.seconds.values()), 's', None, note)
