# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A CAD model that is turned over or lies elsewhere is said, and never the part's failure."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ivfmc_ros.cell import transforms
from ivfmc_ros.inspection.inspect import inspect
from ivfmc_ros.inspection.mesh_file import MeshBody
from ivfmc_ros.inspection.reports.summary import document
from ivfmc_ros.inspection.settings import InspectSettings
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.simulation.parts.solids import stepped_shaft

SETTINGS = InspectSettings(tolerance=0.05e-3, vertex_u=1e-6)
SOLIDS = (box((0.02, 0.03, 0.05)), stepped_shaft([(0.02, 0.015), (0.01, 0.02)]))


def body(solid):
    return MeshBody(vertices_xyz=solid.vertices_xyz, faces=solid.faces, closed=True)


def fine(solid):
    import open3d as o3d

    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(solid.vertices_xyz), o3d.utility.Vector3iVector(solid.faces)
    ).subdivide_midpoint(4)
    return MeshBody(
        vertices_xyz=np.asarray(mesh.vertices), faces=np.asarray(mesh.triangles), closed=True
    )


def flipped(mesh, chosen):
    faces = mesh.faces.copy()
    faces[chosen] = faces[chosen][:, ::-1]
    return replace(mesh, faces=faces)


def summary(mesh, nominal):
    found = document(inspect(mesh, nominal, SETTINGS), SETTINGS)
    return found['verdict'], found['unseen'], found['notes']


def test_sound_nominal_is_left_as_it_is():
    for solid in SOLIDS:
        assert summary(fine(solid), body(solid)) == ('pass', [], [])


def test_faces_that_show_inward_are_turned_over_and_said():
    for solid in SOLIDS:
        nominal = body(solid)
        for chosen in (slice(None), slice(None, None, 2)):
            verdict, unseen, notes = summary(fine(solid), flipped(nominal, chosen))
            assert (verdict, unseen) == ('pass', [])
            assert 'faces showed inward and were turned over' in notes[0]


@pytest.mark.slow
def test_nominal_that_lies_elsewhere_and_is_turned_is_aligned_globally_and_said():
    R = Rotation.from_euler('xyz', [100.0, 40.0, 250.0], degrees=True).as_matrix()
    T = transforms.rigid(R, np.array([0.3, -0.2, 0.1]))
    mesh = fine(SOLIDS[1])
    moved = replace(mesh, vertices_xyz=transforms.apply(T, mesh.vertices_xyz))
    verdict, unseen, notes = summary(moved, body(SOLIDS[1]))
    assert (verdict, unseen) == ('pass', [])
    assert 'aligned globally' in notes[0]


def test_mesh_that_is_not_aligned_is_not_failed_but_said():
    mesh = fine(SOLIDS[0])
    moved = replace(mesh, vertices_xyz=mesh.vertices_xyz + np.array([0.3, 0.0, 0.0]))
    settings = replace(SETTINGS, align='none')
    found = document(inspect(moved, body(SOLIDS[0]), settings), settings)
    assert found['verdict'] == 'not decided'
    assert 'it is another part, or lies elsewhere' in found['notes'][0]
