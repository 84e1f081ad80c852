# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.errors import FileError
from ivfmc_ros.meshing.io.export import write_solid
from ivfmc_ros.meshing.io.stl import read_stl
from ivfmc_ros.simulation.parts.loading import Solid
from ivfmc_ros.simulation.parts.solids import demo_part


@pytest.mark.parametrize('unit', ['m', 'mm', 'inch'])
def test_mesh_is_read_in_meters(tmp_path, unit):
    part = demo_part()
    write_solid(tmp_path / 'part.stl', part.vertices_xyz, part.faces, unit)
    vertices, faces = read_stl(tmp_path / 'part.stl')
    read = Solid(vertices_xyz=vertices, faces=faces)
    assert read.volume == pytest.approx(part.volume, rel=1e-5)
    assert read.watertight
    np.testing.assert_allclose(vertices.max(axis=0), part.vertices_xyz.max(axis=0), atol=1e-8)


@pytest.mark.parametrize(
    ('change', 'problem'),
    [
        (lambda data: data[:-10], 'truncated'),
        (lambda data: b'', 'truncated'),
        (lambda data: b' ' * 80 + data[80:], 'states no unit'),
    ],
)
def test_truncated_file_or_one_without_unit_is_refused(tmp_path, change, problem):
    part = demo_part()
    path = tmp_path / 'part.stl'
    write_solid(path, part.vertices_xyz, part.faces)
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(FileError, match=problem):
        read_stl(path)


def test_missing_file_is_named(tmp_path):
    with pytest.raises(FileError, match='part'):
        read_stl(tmp_path / 'part.stl')
