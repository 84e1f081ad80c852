# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.meshing.io.export import write_mesh
from ivfmc_ros.model import Mesh
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.window import coloring
from ivfmc_ros.window import drawn as modes
from ivfmc_ros.window.mesh_files import compare
from ivfmc_ros.window.mesh_files import load_mesh


@pytest.fixture
def path(tmp_path):
    solid = box((0.02, 0.03, 0.04))
    count = len(solid.vertices_xyz)
    mesh = Mesh(
        vertices_xyz=solid.vertices_xyz,
        faces=solid.faces,
        normals=np.full((count, 3), np.nan),
        sigma=np.full(count, 2e-5),
        # dark below, bright above
        intensity=np.where(solid.vertices_xyz[:, 2] > 0.02, 200.0, 50.0),
    )
    for suffix in ('ply', 'stl'):
        write_mesh(tmp_path / f'mesh.{suffix}', mesh, 'mm')
    return tmp_path / 'mesh.ply'


def test_texture_is_offered_where_the_file_has_colors(path):
    drawn = load_mesh(path, 'mm')
    assert modes.TEXTURE in drawn.modes
    gray = drawn.values[modes.TEXTURE]
    upper = drawn.vertices_xyz[:, 2] > 0.02
    assert gray[upper] == pytest.approx(255, abs=1)
    assert gray[~upper] == pytest.approx(64, abs=2)
    colors = coloring.by_gray(gray)
    assert (colors[upper] > 250).all()
    assert (colors == colors[:, :1]).all()


def test_file_without_colors_has_no_texture(path):
    assert modes.TEXTURE not in load_mesh(path.with_suffix('.stl'), 'mm').modes


def test_compared_mesh_has_both(path):
    drawn = compare(path, 'mm', path, 'mm')
    assert {modes.DEVIATION, modes.TEXTURE} <= set(drawn.modes)
    assert drawn.values[modes.DEVIATION] == pytest.approx(0.0, abs=1e-9)
