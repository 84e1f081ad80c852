# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The controls of the 3-D view, with a server that no browser shows."""

import numpy as np
import pytest

from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.surface import Surface
from ivfmc_ros.window import drawn
from ivfmc_ros.window.access import Access
from ivfmc_ros.window.drawn import DrawnMesh
from ivfmc_ros.window.drawn import DrawnPoints
from ivfmc_ros.window.page import ViewPage
from ivfmc_ros.window.placed_nominal import PlacedNominal
from ivfmc_ros.window.scene_view import BOTH
from ivfmc_ros.window.scene_view import POINTS

BOX = box((0.02, 0.03, 0.05))


@pytest.fixture(scope='module')
def page():
    page = ViewPage('test', '127.0.0.1', 0, Access(), print)
    yield page
    page.close()


@pytest.fixture
def tab(page):
    page.clear()
    page.view_tab._shown.value = 'mesh'
    return page.view_tab


def points():
    count = len(BOX.vertices_xyz)
    return DrawnPoints(
        points_xyz=BOX.vertices_xyz + np.array([0.0, 0.0, 1e-4]),
        laser=np.zeros(count, dtype=int),
        sigma=np.full(count, 1e-5),
        intensity=np.full(count, 100.0),
    )


def mesh(**values):
    return DrawnMesh(vertices_xyz=BOX.vertices_xyz, faces=BOX.faces, values=values)


def nominal():
    return PlacedNominal(
        surface=Surface(BOX.vertices_xyz, BOX.faces),
        nominal_from_mesh=np.eye(4),
        scale=1.0,
        tolerance=5e-5,
    )


def is_visible(page, name):
    return page.scene._scene.get_handle_by_name(name).visible


def test_deviation_is_offered_and_shown_where_there_is_one(page, tab):
    page.show_mesh(mesh())
    assert drawn.DEVIATION not in tab._mesh.options
    page.show_mesh(mesh(deviation=np.zeros(len(BOX.vertices_xyz))))
    assert tab._mesh.value == drawn.DEVIATION
    assert 'deviation, mm' in tab._mesh_scale.content
    page.clear()
    assert tab._mesh.value == drawn.PLAIN
    assert tab._mesh_scale.content == ''


def test_points_are_colored_by_their_deviation_once_the_nominal_is_placed(page, tab):
    page.scene.show_cloud(points())
    assert drawn.DEVIATION not in tab._points.options
    page.scene.place_nominal(nominal())
    page.show_mesh(mesh())
    tab._points.value = drawn.DEVIATION
    # 0.1 mm above the top face of the nominal: beyond its tolerance
    assert 'tolerance ±0.050' in tab._point_scale.content
    colors = page.scene._scene.get_handle_by_name('/cloud').colors
    top = BOX.vertices_xyz[:, 2] == BOX.vertices_xyz[:, 2].max()
    assert (colors[top, 0] > 2.0 * colors[top, 2]).all()
    page.clear()
    assert tab._points.value == drawn.LASER


def test_points_are_shown_until_there_is_a_mesh_and_then_as_chosen(page, tab):
    page.scene.show_cloud(points())
    assert is_visible(page, '/cloud')
    page.show_mesh(mesh())
    assert not is_visible(page, '/cloud')
    tab._shown.value = BOTH
    assert is_visible(page, '/cloud')
    assert is_visible(page, '/mesh')
    tab._shown.value = POINTS
    assert not is_visible(page, '/mesh')


def test_deviation_is_fitted_when_it_is_asked_for_and_replaced_by_the_inspection(page, tab):
    page.scene.show_cloud(points())
    asked = []
    page.scene.offer_fit(lambda xyz: asked.append(len(xyz)))
    tab.offer_modes()
    assert asked == []
    tab._points.value = drawn.DEVIATION
    assert asked == [len(BOX.vertices_xyz)]
    assert 'do not lie on the nominal' in tab._point_scale.content
    page.place_nominal(nominal())
    assert 'deviation, mm' in tab._point_scale.content
    assert asked == [len(BOX.vertices_xyz)]
