# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
import math

import numpy as np
import pytest
from support.synthetic import small_cell
from support.synthetic import Sphere
from support.synthetic import sphere_profiles

from ivfmc_ros.cell import transforms
from ivfmc_ros.registration.closure import find_closures
from ivfmc_ros.registration.sections import split_sections
from ivfmc_ros.registration.views.assemble import assemble
from ivfmc_ros.registration.views.assemble import select_columns

STEPS, CLOSURE = 90, 6
SPHERE = Sphere(np.array([0.012, 0.003, 0.045]), 0.02)


def longer(slip=0.0, after=30, center=SPHERE.center):
    """A turn of one laser and some more, of which the profiles ``after`` lag by ``slip``, rad."""
    (view,) = assemble(
        small_cell(), sphere_profiles(small_cell(), replace(SPHERE, center=center), STEPS)
    )
    columns = np.concatenate([np.arange(STEPS), np.arange(CLOSURE)])
    late = np.arange(STEPS + CLOSURE) >= after
    points = view.points_xyz[:, columns]
    points[:, late] = points[:, late] @ transforms.rotation_z(-slip).T
    return replace(
        view,
        points_xyz=points,
        **{name: getattr(view, name)[:, columns] for name in ('intensity', 'sigma', 'uv')},
        angles=np.arange(STEPS + CLOSURE) * 2.0 * np.pi / STEPS,
        seqs=np.arange(STEPS + CLOSURE),
        color=None,
    )


def closures(*views):
    return find_closures(split_sections(views))


@pytest.mark.parametrize('degrees', [0.0, 0.2, -1.0, 2.5])
def test_rotation_between_end_and_beginning_of_a_sweep(degrees):
    (found,) = closures(longer(math.radians(degrees)))
    assert math.degrees(found.size) == pytest.approx(degrees, abs=0.03)
    assert math.degrees(found.sigma) < 0.02
    assert found.before.angle_to < found.after.angle_from
    assert found.after.angle_from == pytest.approx(2.0 * math.pi, abs=math.radians(4.0))


def test_round_part_constrains_no_rotation():
    found = closures(longer(center=np.array([0.0, 0.0, 0.045])))
    assert all(math.degrees(closure.sigma) > 0.1 for closure in found)


def test_sweep_of_less_than_a_turn_has_no_closure():
    view = longer()
    short = select_columns(view, np.arange(len(view.angles)) < STEPS - 8)
    assert closures(short) == []


def test_other_laser_at_the_same_angle_is_no_closure():
    view = longer()
    assert len(closures(view)) == 1
    other = replace(view, laser=1, number=1, seqs=view.seqs + 1000)
    assert all(c.before.view == c.after.view for c in closures(view, other))


def test_later_sweep_of_the_same_laser_repeats_the_first():
    view, slip = longer(), math.radians(0.5)
    later = replace(
        view,
        number=1,
        points_xyz=view.points_xyz @ transforms.rotation_z(-slip).T,
        seqs=view.seqs + 1000,
    )
    between = [c for c in closures(view, later) if c.before.view != c.after.view]
    assert [math.degrees(c.size) for c in between] == pytest.approx([0.5], abs=0.02)
