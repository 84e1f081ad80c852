# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A coarse mesh is judged by its surface, not by the few vertices that it has."""

import numpy as np
import pytest

from ivfmc_ros.inspection.inspect import inspect
from ivfmc_ros.inspection.mesh_file import MeshBody
from ivfmc_ros.inspection.sampled_mesh import mesh_deviation
from ivfmc_ros.inspection.sampled_mesh import sampled
from ivfmc_ros.inspection.settings import InspectSettings
from ivfmc_ros.inspection.verdict import FAIL
from ivfmc_ros.inspection.verdict import PASS
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.surface import Surface


def body(size, **known):
    solid = box(size)
    return MeshBody(vertices_xyz=solid.vertices_xyz, faces=solid.faces, closed=True, **known)


@pytest.mark.parametrize(('height', 'verdict'), [(0.02, PASS), (0.0203, FAIL)])
def test_box_of_eight_vertices_is_judged_on_its_faces(height, verdict):
    settings = InspectSettings(vertex_u=0.01e-3, align='none')
    found = inspect(body((0.03, 0.04, height)), body((0.03, 0.04, 0.02)), settings)
    judged = {region.name: region for region in found.regions}
    assert len(judged) == 6
    assert all(region.coverage > 0.8 for region in judged.values())
    assert {region.verdict for region in judged.values()} == {PASS, verdict}


def test_what_is_known_of_vertices_stays_theirs():
    mesh = body((0.03, 0.04, 0.02), sigma=np.linspace(1e-6, 8e-6, 8))
    fine = sampled(mesh)
    assert np.array_equal(fine.sigma[:8], mesh.sigma)
    assert fine.sigma.min() == 1e-6
    assert fine.sigma.max() == 8e-6
    assert fine.systematic is None


def test_great_part_does_not_get_millions_of_vertices():
    assert len(sampled(body((1.0, 1.0, 1.0))).vertices_xyz) < 2_000_000


def test_deviation_counts_area_and_not_vertices():
    mesh = sampled(body((0.03, 0.04, 0.0201)))
    # the same surface with a fourth of the vertices
    coarse = body((0.03, 0.04, 0.0201))
    nominal = box((0.03, 0.04, 0.02))
    surface = Surface(nominal.vertices_xyz, nominal.faces)
    few = mesh_deviation(coarse.vertices_xyz, coarse.faces, surface)
    many = mesh_deviation(mesh.vertices_xyz, mesh.faces, surface)
    assert few.rms == pytest.approx(many.rms, rel=0.02)
    # the upper face: 12 of 52 cm2
    assert few.rms == pytest.approx(0.1e-3 * np.sqrt(12 / 52), rel=0.03)
