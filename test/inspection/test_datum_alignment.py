# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.inspection.datum_alignment import align_features
from ivfmc_ros.inspection.mesh_file import MeshBody
from ivfmc_ros.inspection.settings import InspectSettings
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.surface import Surface

SIDE = 0.03
DATUMS = ('plane 1', 'plane 3', 'plane 5')


def body(without=None):
    """Return a block with a vertex a millimeter, but for a face with this normal."""
    solid = box((SIDE, SIDE, SIDE))
    surface = Surface(solid.vertices_xyz, solid.faces)
    grid = np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, 30)] * 2, indexing='ij'), axis=-1)
    vertices, faces = [], []
    cell = np.arange(900).reshape(30, 30)
    quads = np.stack([cell[:-1, :-1], cell[1:, :-1], cell[1:, 1:], cell[:-1, 1:]], axis=-1)
    triangles = quads.reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    for axis in range(3):
        for side in (-1.0, 1.0):
            normal = side * np.eye(3)[axis]
            if without is not None and normal @ without > 0.9:
                continue
            face = np.insert(grid.reshape(-1, 2), axis, side, axis=1) * SIDE / 2
            face[:, 2] += SIDE / 2
            first = face[triangles]
            up = np.cross(first[:, 1] - first[:, 0], first[:, 2] - first[:, 0])[0] @ normal > 0
            vertices.append(face)
            faces.append((triangles if up else triangles[:, ::-1]) + 900 * len(faces))
    assert np.abs(surface.signed_distance(np.concatenate(vertices))).max() < 1e-6
    return MeshBody(
        vertices_xyz=np.concatenate(vertices), faces=np.concatenate(faces), closed=False
    )


def nominal():
    solid = box((SIDE, SIDE, SIDE))
    return MeshBody(vertices_xyz=solid.vertices_xyz, faces=solid.faces, closed=True)


def moved(mesh, T):
    return MeshBody(
        vertices_xyz=transforms.apply(T, mesh.vertices_xyz), faces=mesh.faces, closed=False
    )


def test_datums_determine_the_pose():
    T = np.eye(4)
    T[:3, :3] = transforms.rotation_z(np.array([0.02]))[0]
    T[:3, 3] = 3e-4, -2e-4, 1e-4
    found = align_features(moved(body(), T), nominal(), DATUMS, InspectSettings(tolerance=1e-4))
    assert found.nominal_from_mesh @ T == pytest.approx(np.eye(4), abs=1e-6)


def test_datum_that_was_not_measured_is_named():
    mesh = body(without=np.array([0.0, 0.0, 1.0]))
    wanted = r"datums: 'plane \d' has 0 measured vertices"
    with pytest.raises(GeometryError, match=wanted):
        for number in range(1, 7):
            align_features(mesh, nominal(), [f'plane {number}'], InspectSettings(tolerance=1e-4))
