# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Mesh files that are damaged or oddly named."""

import numpy as np
import pytest

from ivfmc_ros.errors import FileError
from ivfmc_ros.inspection.mesh_file import read_mesh
from ivfmc_ros.simulation.parts.solids import box


def write(path):
    import open3d as o3d

    part = box((0.02, 0.03, 0.04))
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(part.vertices_xyz * 1e3), o3d.utility.Vector3iVector(part.faces)
    )
    mesh.compute_vertex_normals()
    named = path.with_suffix(path.suffix.lower())
    o3d.io.write_triangle_mesh(str(named), mesh)
    named.rename(path)
    return path


@pytest.mark.parametrize('name', ['a.STL', 'b.Ply', 'c.OBJ'])
def test_suffix_in_upper_case_is_read(tmp_path, name):
    body = read_mesh(write(tmp_path / name), 'mm')
    np.testing.assert_allclose(np.ptp(body.vertices_xyz, axis=0), [0.02, 0.03, 0.04], atol=1e-9)


def test_noise_of_the_ply_reader_becomes_the_error(tmp_path, capfd):
    path = write(tmp_path / 'a.ply')
    data = path.read_bytes()
    path.write_bytes(data[: len(data) - 30])
    with pytest.raises(FileError, match=r'a\.ply: is damaged \(Error reading value'):
        read_mesh(path, 'mm')
    assert capfd.readouterr() == ('', '')
