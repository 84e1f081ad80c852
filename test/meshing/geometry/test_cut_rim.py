# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.meshing.geometry.cut_rim import find_cut_rim
from ivfmc_ros.meshing.geometry.cut_rim import rim_figures
from ivfmc_ros.model import Mesh

AROUND, RINGS = 120, 20


def tube(radius, height):
    """An open tube about the axis; its ends are boundary loops at z = 0 and at the height."""
    turn = 2.0 * np.pi * np.arange(AROUND) / AROUND
    z = np.linspace(0.0, height, RINGS)
    points = np.stack(
        [
            np.tile(radius * np.cos(turn), RINGS),
            np.tile(radius * np.sin(turn), RINGS),
            np.repeat(z, AROUND),
        ],
        axis=1,
    )
    return mesh_of(points)


def lid(radius):
    """A disc with a hole at z = 0.02; its outer rim has the radius."""
    turn = 2.0 * np.pi * np.arange(AROUND) / AROUND
    ring = np.repeat(np.linspace(0.3 * radius, radius, RINGS), AROUND)
    turns = np.tile(turn, RINGS)
    z = np.full(len(ring), 0.02)
    return mesh_of(np.stack([ring * np.cos(turns), ring * np.sin(turns), z], axis=1))


def mesh_of(points):
    index = np.arange(len(points)).reshape(RINGS, AROUND)
    a, b = index[:-1], np.roll(index[:-1], -1, axis=1)
    c, d = np.roll(index[1:], -1, axis=1), index[1:]
    faces = np.concatenate([np.stack(f, axis=2).reshape(-1, 3) for f in ((a, b, c), (a, c, d))])
    none = np.full(len(points), np.nan)
    normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    return Mesh(vertices_xyz=points, faces=faces, normals=normals, sigma=none, intensity=none)


def test_rim_at_the_top_is_found():
    rim = find_cut_rim(tube(0.02, 0.0995), Volume())
    assert rim.top == pytest.approx(2.0 * np.pi * 0.02, rel=0.01)
    assert rim.radius == 0.0
    assert rim.vertices.tolist() == list(range((RINGS - 1) * AROUND, RINGS * AROUND))


def test_rim_at_the_radius_is_found():
    rim = find_cut_rim(lid(0.0595), Volume())
    assert rim.radius == pytest.approx(2.0 * np.pi * 0.0595, rel=0.01)
    assert rim.top == 0.0
    assert len(rim.vertices) == AROUND


def test_end_of_the_part_inside_of_the_volume_is_no_cut_rim():
    for mesh in (tube(0.02, 0.08), lid(0.04)):
        assert rim_figures(mesh, Volume()) == {'radius_m': 0.0, 'top_m': 0.0, 'vertices': 0}


def test_closed_mesh_has_no_rim():
    mesh = tube(0.02, 0.0995)
    faces = np.concatenate([mesh.faces, mesh.faces[:, ::-1]])
    both = Mesh(
        vertices_xyz=mesh.vertices_xyz,
        faces=faces,
        normals=mesh.normals,
        sigma=mesh.sigma,
        intensity=mesh.intensity,
    )
    assert len(find_cut_rim(both, Volume()).vertices) == 0
