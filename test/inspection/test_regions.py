# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.cell import transforms
from ivfmc_ros.inspection.regions import segment_surface
from ivfmc_ros.simulation.parts.solids import box


@pytest.mark.parametrize('size', [(0.04, 0.04, 0.04), (0.03, 0.03, 0.05)])
def test_names_do_not_depend_on_where_the_part_lies(size):
    """Faces of one area: rounding would put them in any order."""
    solid = box(size)
    named = {r.name: r.faces.tolist() for r in segment_surface(solid.vertices_xyz, solid.faces)}
    assert sorted(named) == [f'plane {number}' for number in range(1, 7)]
    rng = np.random.default_rng(7)
    for angle in rng.uniform(0.0, 2.0 * np.pi, 50):
        T = transforms.rigid(transforms.rotation_z(np.array([angle]))[0], rng.normal(size=3))
        moved = transforms.apply(T, solid.vertices_xyz)
        found = {r.name: r.faces.tolist() for r in segment_surface(moved, solid.faces)}
        assert found == named


def test_larger_regions_have_the_lower_numbers():
    solid = box((0.02, 0.03, 0.05))
    areas = [region.area for region in segment_surface(solid.vertices_xyz, solid.faces)]
    assert areas == pytest.approx(sorted(areas, reverse=True))
