# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import time

import numpy as np
import pytest
from support.spoilt import CELL
from support.spoilt import views
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
    """A flat piece of quads, one voxel each: vertices and quads."""
    x, y = np.meshgrid(np.arange(columns + 1), np.arange(rows + 1), indexing='ij')
    vertices = VOXEL * np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) + at
    corner = (np.arange(columns)[:, None] * (rows + 1) + np.arange(rows)).ravel()
    return vertices, np.stack([corner, corner + rows + 1, corner + rows + 2, corner + 1], axis=1)


def joined(*sheets):
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in sheets)])
    quads = [quads + start for (_, quads), start in zip(sheets, starts, strict=False)]
    return np.concatenate([vertices for vertices, _ in sheets]), np.concatenate(quads)


def flying(vertices, quads):
    return components.flying(vertices, quads, topology.pieces(quads, len(vertices)), VOXEL)


@pytest.mark.parametrize(('gap', 'size', 'flies'), [(25, 5, 1), (15, 5, 0), (25, 20, 0)])
def test_small_piece_far_from_the_rest_flies(gap, size, flies):
    main = sheet(60, 60, [0.0, 0.0, 0.0])
    vertices, quads = joined(main, sheet(size, 5, [0.06 + gap * VOXEL, 0.0, 0.0]))
    gone, count = flying(vertices, quads)
    assert count == flies
    assert gone.sum() == flies * 5 * size
    assert not gone[: len(main[1])].any()


def test_pieces_that_hold_each_other_up_over_a_gap_stay():
    main = sheet(60, 60, [0.0, 0.0, 0.0])
    steps = [sheet(5, 5 - k, [0.06 + VOXEL * (15 + 20 * k), 0.0, 0.0]) for k in range(3)]
    assert flying(*joined(main, *steps))[1] == 0
    # the middle one holds the last, and does not hold it if it is gone
    assert flying(*joined(main, steps[0], steps[2]))[1] == 1


def test_a_piece_that_flies_holds_no_other():
    main = sheet(60, 60, [0.0, 0.0, 0.0])
    steps = [sheet(5, 5 - k, [0.06 + VOXEL * (25 + 15 * k), 0.0, 0.0]) for k in range(3)]
    assert flying(*joined(main, *steps))[1] == 3


def test_thousands_of_small_pieces_are_judged_in_the_time_of_their_vertices():
    main = sheet(400, 400, [0.0, 0.0, 0.0])
    at = np.stack(np.meshgrid(np.arange(60), np.arange(60)), axis=-1).reshape(-1, 2)
    scraps = [sheet(2, 2, [30 * VOXEL * x, 30 * VOXEL * y, 0.05]) for x, y in at]
    vertices, quads = joined(main, *scraps)
    start = time.process_time()
    gone, count = flying(vertices, quads)
    assert time.process_time() - start < 5.0
    assert count == len(scraps)
    assert gone.sum() == 4 * len(scraps)


def test_piece_that_is_mostly_invented_goes():
    vertices, quads = joined(sheet(20, 20, [0.0, 0.0, 0.0]), sheet(10, 10, [0.5, 0.0, 0.0]))
    kind = np.full(len(quads), MEASURED, dtype=np.uint8)
    piece = topology.pieces(quads, len(vertices))
    assert components.solid(piece, kind, 50).all()
    kind[420:] = FILLED
    assert components.solid(piece, kind, 50).sum() == 400


def test_flying_piece_is_left_out_and_counted():
    far = Sphere(np.array([0.004, 0.002, 0.08]), 0.0033)
    scanned = [views(1)[0], assemble(CELL, sphere_profiles(CELL, far, 400, view=1))[0]]
    mesh = build_mesh(CELL, scanned, Poses.identity(2), MeshSettings(floor=None))
    assert mesh.flying >= 1
    assert mesh.vertices_xyz[:, 2].max() < 0.06
    assert mesh_figures(mesh)['flying_pieces'] == mesh.flying
