# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import time

import numpy as np
import pytest
from support.degraded_views import CELL
from support.degraded_views import views
from support.synthetic import Sphere
from support.synthetic import sphere_profiles

from ivfmc_ros.inspection.reports.scan_page import mesh_figures
from ivfmc_ros.meshing.build import build_mesh
from ivfmc_ros.meshing.filters import components
from ivfmc_ros.meshing.geometry import topology
from ivfmc_ros.meshing.settings import MeshSettings
from ivfmc_ros.model import FILLED
from ivfmc_ros.model import MEASURED
from ivfmc_ros.model import Poses
from ivfmc_ros.registration.views.assemble import assemble

VOXEL = 1e-3


def sheet(columns, rows, at):
    """Return vertices and quads of a flat sheet of quads of one voxel."""
    x, y = np.meshgrid(np.arange(columns + 1), np.arange(rows + 1), indexing='ij')
    vertices = VOXEL * np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) + at
    corner = (np.arange(columns)[:, None] * (rows + 1) + np.arange(rows)).ravel()
    return vertices, np.stack([corner, corner + rows + 1, corner + rows + 2, corner + 1], axis=1)


def concatenate(*sheets):
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in sheets)])
    quads = [quads + start for (_, quads), start in zip(sheets, starts, strict=False)]
    return np.concatenate([vertices for vertices, _ in sheets]), np.concatenate(quads)


def find_isolated(vertices, quads):
    component = topology.face_components(quads, len(vertices))
    return components.find_isolated_components(vertices, quads, component, VOXEL)


@pytest.mark.parametrize(('gap', 'size', 'isolated'), [(25, 5, 1), (15, 5, 0), (25, 20, 0)])
def test_small_component_far_from_the_rest_is_isolated(gap, size, isolated):
    main = sheet(60, 60, [0.0, 0.0, 0.0])
    vertices, quads = concatenate(main, sheet(size, 5, [0.06 + gap * VOXEL, 0.0, 0.0]))
    gone, count = find_isolated(vertices, quads)
    assert count == isolated
    assert gone.sum() == isolated * 5 * size
    assert not gone[: len(main[1])].any()


def test_components_connected_by_a_chain_of_near_ones_are_kept():
    main = sheet(60, 60, [0.0, 0.0, 0.0])
    steps = [sheet(5, 5 - k, [0.06 + VOXEL * (15 + 20 * k), 0.0, 0.0]) for k in range(3)]
    assert find_isolated(*concatenate(main, *steps))[1] == 0
    # without the middle one the last is isolated
    assert find_isolated(*concatenate(main, steps[0], steps[2]))[1] == 1


def test_isolated_component_does_not_keep_others():
    main = sheet(60, 60, [0.0, 0.0, 0.0])
    steps = [sheet(5, 5 - k, [0.06 + VOXEL * (25 + 15 * k), 0.0, 0.0]) for k in range(3)]
    assert find_isolated(*concatenate(main, *steps))[1] == 3


def test_time_for_thousands_of_components_is_linear_in_their_vertices():
    main = sheet(400, 400, [0.0, 0.0, 0.0])
    at = np.stack(np.meshgrid(np.arange(60), np.arange(60)), axis=-1).reshape(-1, 2)
    fragments = [sheet(2, 2, [30 * VOXEL * x, 30 * VOXEL * y, 0.05]) for x, y in at]
    vertices, quads = concatenate(main, *fragments)
    start = time.process_time()
    gone, count = find_isolated(vertices, quads)
    assert time.process_time() - start < 5.0
    assert count == len(fragments)
    assert gone.sum() == 4 * len(fragments)


def test_component_that_is_mostly_filled_is_dropped():
    vertices, quads = concatenate(sheet(20, 20, [0.0, 0.0, 0.0]), sheet(10, 10, [0.5, 0.0, 0.0]))
    kind = np.full(len(quads), MEASURED, dtype=np.uint8)
    component = topology.face_components(quads, len(vertices))
    assert components.select_components(component, kind, 50).all()
    kind[420:] = FILLED
    assert components.select_components(component, kind, 50).sum() == 400


def test_isolated_component_is_dropped_and_counted():
    far = Sphere(np.array([0.004, 0.002, 0.08]), 0.0033)
    scanned = [views(1)[0], assemble(CELL, sphere_profiles(CELL, far, 400, view=1))[0]]
    mesh = build_mesh(CELL, scanned, Poses.identity(2), MeshSettings(floor=None))
    assert mesh.isolated_components >= 1
    assert mesh.vertices_xyz[:, 2].max() < 0.06
    assert mesh_figures(mesh)['isolated_components'] == mesh.isolated_components
