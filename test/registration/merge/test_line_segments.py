# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from support.surfaces import block
from support.surfaces import empty

from ivfmc_ros.registration.merge.line_segments import strokes_of
from ivfmc_ros.registration.solver.downsample import sample
from ivfmc_ros.registration.solver.surfels import fit_patches

EDGE, REACH = 8e-4, 2e-3


def sight_of(view):
    return np.tile([0.0, 0.0, 0.3], (np.count_nonzero(view.valid), 1))


def test_strokes_lie_along_the_profiles_of_a_surface():
    view = block()
    strokes = strokes_of(view, sight_of(view), REACH)
    assert len(strokes) > 100
    np.testing.assert_allclose(np.linalg.norm(strokes.ways, axis=1), 1.0)
    np.testing.assert_allclose(strokes.sight, np.tile([0.0, 0.0, 1.0], (len(strokes), 1)))
    # between the first and the last point of a profile
    low, high = (pick(view.cloud(), axis=0) for pick in (np.min, np.max))
    inside = (strokes.points_xyz > low - 1e-9) & (strokes.points_xyz < high + 1e-9)
    assert inside.all()


def test_points_over_a_gap_are_no_stroke():
    view = block()
    assert not len(strokes_of(view, sight_of(view), 1e-6))


def test_what_lies_on_a_patch_is_left_out_and_a_wall_beside_it_is_not():
    view = block()
    patches = fit_patches(sample(view, EDGE), EDGE)
    strokes = strokes_of(view, sight_of(view), REACH)
    assert len(strokes.beside(patches, EDGE)) < 0.1 * len(strokes)
    lifted = np.eye(4)
    lifted[2, 3] = 3e-3
    raised = strokes.posed(lifted)
    assert len(raised.beside(patches, EDGE)) == len(strokes)
    along = type(strokes)(
        points_xyz=strokes.points_xyz,
        ways=np.tile([0.0, 0.0, 1.0], (len(strokes), 1)),
        sight=strokes.sight,
        sigma=strokes.sigma,
    )
    assert len(along.beside(patches, EDGE)) > 0.9 * len(strokes)


def test_an_empty_view_has_no_strokes():
    view = empty(block())
    assert not len(strokes_of(view, np.empty((0, 3)), REACH))
