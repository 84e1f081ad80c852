# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.cell.laser import Bow
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.errors import CellError

NORMAL = np.array([0.8, 0.1, -np.sqrt(1 - 0.65)])
OFFSET = 0.23


def bow_of(*coefficients):
    along = np.cross(NORMAL, [0.0, 1.0, 0.0])
    along /= np.linalg.norm(along)
    return Bow(center=-OFFSET * NORMAL, along=along, coefficients=np.array(coefficients))


def sheet(bow=None, **changes):
    return LaserPlane(
        **{'name': 'left', 'normal': NORMAL, 'offset': OFFSET, 'bow': bow, **changes}
    )


def rays_at(count=400, seed=1):
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-0.25, 0.25, (count, 2)), np.ones(count)])


def test_intersections_lie_in_the_plane():
    points = sheet().intersect(rays_at())
    assert np.isfinite(points).all()
    assert np.abs(sheet().distance(points)).max() < 1e-15
    assert np.allclose(points / points[:, 2:], rays_at(), atol=1e-15)


@pytest.mark.parametrize('bow', [(0.4, 0.0, 0.0), (0.0, 0.0, -0.3), (0.2, -0.5, 0.3)])
def test_intersections_lie_in_the_bowed_sheet(bow):
    bowed = sheet(bow_of(*bow))
    points = bowed.intersect(rays_at())
    assert np.isfinite(points).all()
    assert np.abs(bowed.distance(points)).max() < 1e-14
    # and the bow is worth testing
    assert np.abs(sheet().distance(points)).max() > 1e-3


def test_bow_with_zero_coefficients_is_a_plane():
    bowed = sheet(bow_of(0.0, 0.0, 0.0)).intersect(rays_at())
    assert np.allclose(bowed, sheet().intersect(rays_at()), atol=1e-15)


def test_bow_bends_to_the_side_of_the_normal():
    bow = bow_of(0.5, 0.0, 0.0)
    on_sheet = bow.center + 0.1 * bow.along + 0.5 * 0.01 * NORMAL
    assert sheet(bow).distance(on_sheet[None])[0] == pytest.approx(0.0, abs=1e-15)
    assert sheet().distance(on_sheet[None])[0] == pytest.approx(0.005)


def test_distance_is_signed_along_the_normal():
    on_plane = -OFFSET * NORMAL
    points = np.stack([on_plane + 0.01 * NORMAL, on_plane - 0.02 * NORMAL])
    assert sheet().distance(points) == pytest.approx([0.01, -0.02])


@pytest.mark.parametrize('bow', [None, bow_of(0.2, 0.1, 0.1)])
def test_ray_that_leaves_the_sheet_behind_misses(bow):
    # n.ray > 0 with d > 0: the meeting point lies behind the camera
    behind = np.array([[2.0, 0.0, 1.0]])
    assert np.isnan(sheet(bow).intersect(behind)).all()


def test_ray_along_the_plane_misses():
    flat = LaserPlane(name='x', normal=np.array([1.0, 0.0, 0.0]), offset=0.1)
    assert np.isnan(flat.intersect(np.array([[0.0, 0.2, 1.0]]))).all()


def test_ray_that_passes_a_strong_bow_misses():
    # a parabola that opens away from the ray has no point on it
    bowed = sheet(bow_of(-400.0, 0.0, -400.0))
    points = bowed.intersect(np.array([[2.0, 0.0, 1.0]]))
    assert np.isnan(points).all()


def test_no_rays_give_no_points():
    assert sheet().intersect(np.empty((0, 3))).shape == (0, 3)
    assert sheet(bow_of(0.1, 0.1, 0.1)).intersect(np.empty((0, 3))).shape == (0, 3)


@pytest.mark.parametrize('offset', [0.0, 5e-4, -5e-4])
def test_camera_center_in_the_plane_is_refused(offset):
    with pytest.raises(CellError, match='plane: the camera center lies in the laser plane'):
        sheet(offset=offset)


@pytest.mark.parametrize('factor', [0.999, 1.001, 0.0, np.nan, np.inf])
def test_normal_that_is_not_unit_is_refused(factor):
    with pytest.raises(CellError, match=r'plane: the normal .* must have length 1'):
        sheet(normal=NORMAL * factor)


def test_offset_that_is_no_number_is_refused():
    with pytest.raises(CellError, match='plane: the offset'):
        sheet(offset=np.nan)


def test_normal_of_six_decimals_is_taken():
    normal = np.round(NORMAL, 6)
    assert np.array_equal(sheet(normal=normal).normal, normal)


def test_bow_along_a_vector_that_is_not_unit_is_refused():
    bow = bow_of(0.1, 0.0, 0.0)
    with pytest.raises(CellError, match='bow: along: must be a unit vector in the plane'):
        sheet(Bow(center=bow.center, along=1.1 * bow.along, coefficients=bow.coefficients))


def test_bow_along_a_vector_out_of_the_plane_is_refused():
    bow = bow_of(0.1, 0.0, 0.0)
    with pytest.raises(CellError, match='bow: along: must be a unit vector in the plane'):
        sheet(Bow(center=bow.center, along=NORMAL, coefficients=bow.coefficients))
