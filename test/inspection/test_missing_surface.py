# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a scan left out, and the pose of the part that shows it."""

import numpy as np
import pytest

from ivfmc_ros.inspection.inspect import inspect
from ivfmc_ros.inspection.mesh_file import MeshBody
from ivfmc_ros.inspection.missing_surface import missing_surface
from ivfmc_ros.inspection.missing_surface import missing_texts
from ivfmc_ros.inspection.regions import segment_surface
from ivfmc_ros.inspection.reports.summary import document
from ivfmc_ros.inspection.sampled_mesh import sampled
from ivfmc_ros.inspection.settings import InspectSettings
from ivfmc_ros.meshing.geometry.normals import face_normals
from ivfmc_ros.meshing.geometry.normals import vertex_normals
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.prism import circle
from ivfmc_ros.simulation.parts.prism import Layer
from ivfmc_ros.simulation.parts.prism import stack
from ivfmc_ros.simulation.parts.solids import box

SIZE = (0.03, 0.04, 0.02)
BOX = box(SIZE)
# of the whole surface
BOTTOM = 12 / 52


def body(solid, keep=None, **known):
    faces = solid.faces if keep is None else solid.faces[keep]
    return MeshBody(vertices_xyz=solid.vertices_xyz, faces=faces, closed=keep is None, **known)


def missing_of(solid, keep):
    nominal = body(solid)
    regions = segment_surface(nominal.vertices_xyz, nominal.faces)
    mesh = sampled(body(solid, keep))
    normals = vertex_normals(mesh.vertices_xyz, mesh.faces)
    used = np.isfinite(normals[:, 0])
    found = missing_surface(nominal, regions, mesh.vertices_xyz[used], normals[used], bench_cell())
    return found, {region.name: region for region in regions}


def test_bottom_of_a_box_is_shown_by_another_side():
    normals = face_normals(BOX.vertices_xyz, BOX.faces)
    found, regions = missing_of(BOX, normals[:, 2] > -0.5)
    assert found.share == pytest.approx(BOTTOM, abs=0.02)
    (pose,) = found.poses
    assert pose.shows > 0.95
    (name,) = pose.rests_on
    assert regions[name].shape.kind == 'plane'
    # not on the face that is to be seen
    assert pose.down[2] > -0.5
    first, second = missing_texts(found)
    assert first == '23 % of the surface of the nominal was not measured'
    assert second.startswith(f'lay the part on {name}: the camera sees ')


def test_opposite_sides_need_two_poses():
    nominal = body(BOX)
    regions = segment_surface(nominal.vertices_xyz, nominal.faces)
    nothing = np.full((1, 3), 9.0), np.array([[0.0, 0.0, 1.0]])
    found = missing_surface(nominal, regions, *nothing, bench_cell())
    assert found.share == 1.0
    first, second = found.poses
    assert 0.5 < first.shows < 0.95
    assert second.shows > 0.95
    assert missing_texts(found)[2].endswith('% of the rest')


def test_walls_of_a_deep_bore_are_shown_by_no_pose():
    well = stack(
        [
            Layer(low=0.0, high=0.01, bottom=[circle(0.02)]),
            Layer(low=0.01, high=0.06, bottom=[circle(0.02), circle(0.004)[::-1]]),
        ]
    )
    corners = well.vertices_xyz[well.faces]
    wall = (np.hypot(corners[..., 0], corners[..., 1]) < 0.0041).all(axis=1)
    found, _ = missing_of(well, ~wall)
    assert found.share == pytest.approx(0.12, abs=0.03)
    # but for their upper end
    assert all(pose.shows < 0.3 for pose in found.poses)


def test_complete_mesh_misses_nothing():
    found, _ = missing_of(BOX, np.ones(len(BOX.faces), dtype=bool))
    assert found.share < 0.01
    assert missing_texts(found) == []


def test_inspection_states_it_where_the_cell_is_known():
    normals = face_normals(BOX.vertices_xyz, BOX.faces)
    mesh = body(
        BOX,
        normals[:, 2] > -0.5,
        sigma=np.full(len(BOX.vertices_xyz), 1e-6),
        systematic=np.zeros(len(BOX.vertices_xyz)),
    )
    settings = InspectSettings(align='none')
    assert inspect(mesh, body(BOX), settings).missing is None
    said = document(inspect(mesh, body(BOX), settings, bench_cell()), settings)['missing']
    assert said['share'] == pytest.approx(BOTTOM, abs=0.02)
    assert said['poses'][0]['shows'] > 0.95
    assert np.linalg.norm(said['poses'][0]['down']) == pytest.approx(1.0)
