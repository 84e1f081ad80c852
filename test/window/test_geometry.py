# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""CuttingPlane plane, picking, colors, and the drawn cell."""

import numpy as np
import pytest

from ivfmc_ros.cell import transforms
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.solids import demo_part
from ivfmc_ros.window import cell_drawing
from ivfmc_ros.window import coloring
from ivfmc_ros.window import drawn
from ivfmc_ros.window.drawn import DrawnMesh
from ivfmc_ros.window.measuring import Measurement
from ivfmc_ros.window.section import cut_mesh
from ivfmc_ros.window.section import CuttingPlane

CORNERS = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
CUBE = np.array(
    [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6),
     (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]
)  # fmt: skip


@pytest.mark.parametrize('axis', ['x', 'y', 'z'])
def test_outline_of_a_cut_cube_is_its_square(axis):
    kept, outline = cut_mesh(CORNERS, CUBE, CuttingPlane(axis=axis, position=0.25))
    # only the face at 0 lies on the near side as a whole
    assert np.count_nonzero(kept) == 2
    column = 'xyz'.index(axis)
    np.testing.assert_allclose(outline[..., column], 0.25)
    assert np.linalg.norm(outline[:, 1] - outline[:, 0], axis=1).sum() == pytest.approx(4.0)


def test_plane_beside_a_mesh_keeps_or_hides_all_of_it():
    for position, kept in ((2.0, 12), (-1.0, 0)):
        found, outline = cut_mesh(CORNERS, CUBE, CuttingPlane(axis='z', position=position))
        assert np.count_nonzero(found) == kept
        assert outline.shape == (0, 2, 3)
    found, outline = cut_mesh(CORNERS, CUBE, CuttingPlane())
    assert found.all()
    assert len(outline) == 0


def test_what_a_plane_hides_is_not_picked():
    plane = CuttingPlane(axis='x', position=0.5)
    np.testing.assert_array_equal(plane.near_side(CORNERS), CORNERS[CORNERS[:, 0] == 0.0])
    np.testing.assert_array_equal(CuttingPlane().near_side(CORNERS), CORNERS)


def test_section_of_a_real_part_is_closed():
    solid = demo_part()
    _, outline = cut_mesh(solid.vertices_xyz, solid.faces, CuttingPlane(axis='z', position=0.0123))
    ends = np.round(outline.reshape(-1, 3), 9)
    _, counts = np.unique(ends, axis=0, return_counts=True)
    # every end of a segment is the end of another one
    assert (counts % 2 == 0).all()


def test_point_in_front_is_picked_and_not_the_one_behind():
    points = np.array([(0.0, 0.0, 0.1), (0.0, 0.0, 0.05), (0.02, 0.0, 0.08)])
    found = Measurement.pick(points, np.array([0.0, 0.0, 0.5]), np.array([0.0, 0.0, -2.0]))
    np.testing.assert_array_equal(found, points[0])
    aside = Measurement.pick(points, np.array([0.1, 0.0, 0.5]), np.array([0.0, 0.0, -1.0]))
    assert aside is None


def test_distance_is_said_with_its_components():
    measured = Measurement(first_xyz=np.zeros(3), second_xyz=np.array([0.003, 0.0, -0.004]))
    assert measured.text == '5.00 mm  (x +3.00, y +0.00, z -4.00)'


def test_scale_of_a_deviation_is_green_at_zero():
    values = np.array([0.0, 1e-3, -1e-3])
    mesh = DrawnMesh(
        vertices_xyz=np.zeros((3, 3)), faces=CUBE[:1], values={drawn.DEVIATION: values}
    )
    (green, red, blue), bar = coloring.color_mesh(mesh, drawn.DEVIATION)
    assert bar.low == -bar.high
    assert green[1] > max(green[0], green[2])
    assert red[0] > 2 * red[2]
    assert blue[2] > 2 * blue[0]
    # the page writes the unit at the scale
    assert 'deviation, mm' in coloring.bar_html(bar)


def test_colors_of_gltf_are_linear_light():
    colors = coloring.linear(np.array([(0, 128, 255), (10, 188, 64)], dtype=np.uint8))
    # sRGB of a half is 188, that of 0.2158 is 128
    assert colors.tolist() == [[0, 55, 255, 255], [1, 128, 13, 255]]


def test_deviation_from_a_nominal_has_the_scale_of_its_report():
    values = np.array([0.0, 1e-3, -1e-3])
    mesh = DrawnMesh(
        vertices_xyz=np.zeros((3, 3)),
        faces=CUBE[:1],
        values={drawn.DEVIATION: values},
        tolerance=1e-4,
    )
    _, bar = coloring.color_mesh(mesh, drawn.DEVIATION)
    assert (bar.low, bar.high, bar.tolerance) == (-2e-4, 2e-4, 1e-4)


def test_unknown_values_are_gray():
    values = {drawn.SIGMA: np.array([np.nan, 2e-5, 3e-5])}
    mesh = DrawnMesh(vertices_xyz=np.zeros((3, 3)), faces=CUBE[:1], values=values)
    colors, _ = coloring.color_mesh(mesh, drawn.SIGMA)
    assert np.ptp(colors[0].astype(int)) < 20
    assert np.ptp(colors[1].astype(int)) > 60
    assert coloring.span_of(np.full(3, np.nan)) == (0.0, 1.0)


def test_light_sheets_lie_in_the_planes_of_the_lasers():
    cell = bench_cell()
    sheets = cell_drawing.light_sheets(cell, 0.06, 0.1)
    assert [sheet.name for sheet in sheets] == [laser.name for laser in cell.lasers]
    for sheet, laser in zip(sheets, cell.lasers, strict=True):
        in_camera = transforms.apply(cell.turntable.camera_from_base, sheet.vertices_xyz)
        np.testing.assert_allclose(laser.distance(in_camera), 0.0, atol=1e-12)
        assert np.linalg.norm(sheet.vertices_xyz[:, :2], axis=1).max() == pytest.approx(0.06)
        assert set(np.round(sheet.vertices_xyz[:, 2], 9)) == {0.0, 0.1}


def test_field_of_view_of_the_camera_holds_the_axis():
    cell = bench_cell()
    outline = cell_drawing.camera_outline(cell)
    center = transforms.invert(cell.turntable.camera_from_base)[:3, 3]
    np.testing.assert_allclose(outline[:4, 0], np.tile(center, (4, 1)))
    middle = outline[:4, 1].mean(axis=0)
    # it looks from its place towards the axis
    assert np.linalg.norm(middle[:2]) < np.linalg.norm(center[:2])


def test_volume_and_platter_have_the_given_size():
    outline = cell_drawing.volume_outline(0.05, 0.08)
    assert outline[..., 2].max() == 0.08
    np.testing.assert_allclose(np.linalg.norm(outline[..., :2], axis=-1), 0.05)
    disc = cell_drawing.platter(0.05)
    assert disc.vertices_xyz[:, 2].max() < 0.0
