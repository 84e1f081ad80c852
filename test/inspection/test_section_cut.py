# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
import re

import numpy as np
import open3d as o3d
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.inspection.inspect import inspect
from ivfmc_ros.inspection.mesh_file import MeshBody
from ivfmc_ros.inspection.reports.section_drawings import section_figure
from ivfmc_ros.inspection.reports.summary import document
from ivfmc_ros.inspection.section_plane import MIDDLE_PLANES
from ivfmc_ros.inspection.section_plane import parse_section
from ivfmc_ros.inspection.section_plane import parse_sections
from ivfmc_ros.inspection.section_plane import SectionPlane
from ivfmc_ros.inspection.settings import InspectSettings
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.simulation.parts.solids import demo_part
from ivfmc_ros.simulation.parts.solids import sphere

SIZE = (0.02, 0.03, 0.05)
BOX = box(SIZE)
SURE = 2e-6


def body(solid, rounds=0):
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(solid.vertices_xyz), o3d.utility.Vector3iVector(solid.faces)
    ).subdivide_midpoint(rounds)
    return MeshBody(
        vertices_xyz=np.asarray(mesh.vertices), faces=np.asarray(mesh.triangles), closed=True
    )


def cuts(mesh, *planes, nominal=None, **others):
    settings = InspectSettings(
        align='none', sections=tuple(map(parse_section, planes)), **{'vertex_u': SURE, **others}
    )
    return inspect(mesh, nominal or body(BOX), settings).sections


def bulged(height=0.15e-3, radius=0.006):
    """The box with a round bulge in the middle of the face at +y."""
    mesh = body(BOX, 6)
    xyz = mesh.vertices_xyz.copy()
    top = xyz[:, 1].max()
    near = (xyz[:, 1] > top - 1e-9) & (np.hypot(xyz[:, 0], xyz[:, 2] - 0.025) < radius)
    xyz[near, 1] += height
    return replace(mesh, vertices_xyz=xyz)


def test_contour_of_a_box_has_its_circumference():
    (cut,) = cuts(body(BOX, 4), 'z=20')
    assert cut.nominal_length == pytest.approx(2 * (SIZE[0] + SIZE[1]))
    assert np.ptp(cut.measured.reshape(-1, 2), axis=0) == pytest.approx(SIZE[:2])
    assert cut.worst == pytest.approx(0.0, abs=1e-6)
    # a millimeter at each of the four edges, on both sides, and what is left of a triangle
    assert 0.7 < cut.judged_length / (cut.nominal_length - 8e-3) <= 1.0


def test_plane_through_vertices_cuts_every_triangle_once():
    # a vertex of the sphere lies on its equator, and the cut stays closed
    (cut,) = cuts(body(sphere(0.02)), 'z', nominal=body(sphere(0.02)))
    ends = np.round(cut.measured.reshape(-1, 2), 9)
    _, count = np.unique(ends, axis=0, return_counts=True)
    assert len(ends) > 20
    assert (count % 2 == 0).all()


def test_bulge_is_found_in_its_section_with_size_place_and_uncertainty():
    near, far = cuts(bulged(), 'z=25', 'z=40')
    assert near.worst == pytest.approx(0.15e-3, rel=0.01)
    assert near.worst_u == pytest.approx(2 * SURE)
    place = near.measured.reshape(-1, 2)[near.worst_end]
    assert place == pytest.approx([0.0, SIZE[1] / 2], abs=0.0062)
    assert abs(far.worst) < 1e-6
    assert near.rms > 0.03e-3 > far.rms


def test_edges_and_filled_holes_are_drawn_and_do_not_count():
    mesh = bulged()
    top = mesh.vertices_xyz[:, 1] > SIZE[1] / 2 - 1e-6
    sigma = np.where(top, np.nan, SURE)
    filled = replace(mesh, sigma=sigma, systematic=np.zeros(len(sigma)))
    (cut,) = cuts(filled, 'z=25', vertex_u=None)
    assert cut.filled.any()
    assert not (cut.filled & cut.judged).any()
    assert abs(cut.worst) < 1e-6
    assert np.isnan(cut.worst_u)
    rounded = cuts(body(BOX, 5), 'z=25', edge=0.2)[0]
    assert not rounded.judged.any()
    assert np.isnan([rounded.worst, rounded.rms, rounded.median_u]).all()
    assert 'nothing was measured here' in section_figure(rounded, 1e-4)


def test_holes_have_contours_of_their_own():
    # the flange of the demo part with its six bolt holes
    (cut,) = cuts(body(demo_part()), 'z=5', nominal=body(demo_part()))
    _, corner = np.unique(np.round(cut.measured, 9).reshape(-1, 2), axis=0, return_inverse=True)
    ends = corner.reshape(-1, 2)
    graph = coo_array((np.ones(len(ends)), ends.T), shape=(ends.max() + 1,) * 2)
    assert connected_components(graph)[0] == 1 + 6


def test_deviations_are_drawn_larger_by_the_stated_factor():
    plain, bulge = (cuts(mesh, 'z=25')[0] for mesh in (body(BOX, 6), bulged()))
    text = section_figure(bulge, 0.1e-3)
    factor = float(re.search(r'deviations (\d+) times as large', text)[1])
    assert factor > 1
    scale = (
        1e3
        * float(re.search(r'h([\d.]+)v-5', text)[1])
        / float(re.search(r'>(\d+) mm</text>', text)[1])
    )
    nominal, measured = (drawn_top(text, colors) for colors in ('5a6675', '1f5fa8|c22020'))
    assert nominal - measured == pytest.approx(factor * 0.15e-3 * scale, abs=0.4)
    assert '+0.150 mm, U = 0.004 mm (k = 2)' in text
    assert '±0.1 mm' in text
    assert '#c22020' in text
    assert '#c22020' not in section_figure(plain, 0.1e-3)


def drawn_top(text, colors):
    """The highest point of the lines of some colors in a drawing."""
    lines = re.findall(rf'<path d="([^"]*)" stroke="#(?:{colors})"', text)
    return min(float(y) for line in lines for y in re.findall(r'[ML][-\d.e]+ ([-\d.e]+)', line))


def test_huge_deviation_is_drawn_up_to_a_limit_and_said():
    (cut,) = cuts(bulged(2e-3), 'z=25')
    assert 'drawn up to 0.3 mm' in section_figure(cut, 0.1e-3)


def test_report_has_a_row_for_each_section():
    settings = InspectSettings(align='none', vertex_u=SURE)
    rows = document(inspect(bulged(), body(BOX), settings), settings)['sections']
    assert [row['axis'] for row in rows] == ['x', 'y', 'z']
    assert rows[0]['offset_m'] == pytest.approx(0.0, abs=1e-9)
    assert rows[2]['worst_m'] == pytest.approx(0.15e-3, rel=0.01)
    assert rows[2]['name'] == 'z = 25.000 mm'


@pytest.mark.parametrize(
    ('text', 'plane'),
    [
        ('z=12.5', SectionPlane('z', 0.0125)),
        (' x = -3 mm ', SectionPlane('x', -0.003)),
        ('y', SectionPlane('y')),
        ('y=.5', SectionPlane('y', 0.0005)),
    ],
)
def test_plane_is_read(text, plane):
    assert parse_section(text).axis == plane.axis
    assert parse_section(text).offset == (plane.offset and pytest.approx(plane.offset))


@pytest.mark.parametrize('text', ['w=1', 'z=', 'z=1m', 'z=nan', 'z=1e9', 'z 1', '', 'none', 'Z=1'])
def test_what_is_no_plane_is_refused(text):
    with pytest.raises(ParameterError, match='section: '):
        parse_section(text)


def test_planes_may_be_none_but_not_twice_the_same():
    assert parse_sections(['none']) == parse_sections([]) == ()
    assert parse_sections('xyz') == MIDDLE_PLANES
    with pytest.raises(ParameterError, match=r"'z=1\.0' is given twice"):
        parse_sections(['z=1', 'z=1.0'])
    with pytest.raises(ParameterError, match="'none' is not understood"):
        parse_sections(['z=1', 'none'])


def test_plane_beside_the_part_is_refused_with_where_the_part_is():
    with pytest.raises(ParameterError, match=r'z=80 mm does not cut .* z = 0 and 50 mm'):
        cuts(body(BOX, 3), 'z=80')
