# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.simulation.parts.loading import load_stl
from ivfmc_ros.simulation.parts.loading import Platter
from ivfmc_ros.simulation.parts.loading import Solid
from ivfmc_ros.simulation.parts.solids import box

SIZE = (0.04, 0.03, 0.02)


def write_stl(path, solid, per_metre=1.0, faces=None):
    """Write a binary STL as CAD does."""
    corners = solid.vertices_xyz[solid.faces if faces is None else faces] * per_metre
    records = np.zeros(len(corners), dtype=[('f', '<f4', 12), ('attribute', '<u2')])
    records['f'][:, 3:] = corners.reshape(-1, 9)
    count = np.array([len(corners)], dtype='<u4')
    path.write_bytes(b'\0' * 80 + count.tobytes() + records.tobytes())
    return path


@pytest.mark.parametrize(('unit', 'per_metre'), [('m', 1.0), ('mm', 1e3), ('inch', 1 / 0.0254)])
def test_stl_is_read_in_the_unit_given(tmp_path, unit, per_metre):
    solid = load_stl(write_stl(tmp_path / 'part.stl', box(SIZE), per_metre), unit)
    assert np.ptp(solid.vertices_xyz, axis=0) == pytest.approx(SIZE)
    assert solid.watertight
    assert solid.volume == pytest.approx(np.prod(SIZE))


def test_unknown_unit_is_refused(tmp_path):
    with pytest.raises(ParameterError, match="'cm' is not one of"):
        load_stl(write_stl(tmp_path / 'part.stl', box(SIZE)), 'cm')


def test_missing_stl_is_refused(tmp_path):
    with pytest.raises(FileError, match=r'none\.stl: there is no such file'):
        load_stl(tmp_path / 'none.stl', 'mm')


def test_other_suffix_is_refused(tmp_path):
    with pytest.raises(FileError, match=r'part\.step: is no STL'):
        load_stl(tmp_path / 'part.step', 'mm')


@pytest.mark.parametrize('kept', [0, 60, 84, 300])
def test_truncated_stl_is_refused(tmp_path, kept):
    path = write_stl(tmp_path / 'part.stl', box(SIZE))
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(FileError, match=r'part\.stl: holds no triangles'):
        load_stl(path, 'mm')


def test_open_stl_is_refused(tmp_path):
    path = write_stl(tmp_path / 'part.stl', box(SIZE), faces=box(SIZE).faces[:-1])
    with pytest.raises(GeometryError, match=r'part\.stl: the triangles do not close'):
        load_stl(path, 'mm')


def test_inverted_stl_is_refused(tmp_path):
    path = write_stl(tmp_path / 'part.stl', box(SIZE), faces=box(SIZE).faces[:, ::-1])
    with pytest.raises(GeometryError, match='face inward'):
        load_stl(path, 'mm')


def test_stl_without_numbers_is_refused(tmp_path):
    broken = box(SIZE)
    broken.vertices_xyz[0, 0] = np.nan
    with pytest.raises(GeometryError):
        load_stl(write_stl(tmp_path / 'part.stl', broken), 'mm')


def test_solid_moves_as_a_whole():
    pose = transforms.rigid(transforms.rotation_z(np.pi / 2), (0.01, 0.0, 0.005))
    moved = box(SIZE).moved(pose)
    assert moved.vertices_xyz.min(axis=0) == pytest.approx([-0.005, -0.02, 0.005])
    assert moved.volume == pytest.approx(np.prod(SIZE))


@pytest.mark.parametrize('faces', [np.zeros((0, 3), int), np.zeros((2, 4), int)])
def test_solid_without_triangles_is_refused(faces):
    with pytest.raises(ValueError, match='faces has shape'):
        Solid(vertices_xyz=np.zeros((3, 3)), faces=faces)


@pytest.mark.parametrize('wrong', [{'radius': 0.0}, {'radius': np.nan}, {'reflectance': 1.5}])
def test_impossible_platter_is_refused(wrong):
    with pytest.raises(ParameterError, match='platter'):
        Platter(**wrong)
