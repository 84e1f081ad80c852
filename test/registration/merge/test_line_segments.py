# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from support.surfaces import empty
from support.surfaces import wavy_view

from ivfmc_ros.registration.merge.line_segments import extract_line_segments
from ivfmc_ros.registration.solver.downsample import downsample
from ivfmc_ros.registration.solver.surfels import fit_surfels

EDGE, MAX_GAP = 8e-4, 2e-3


def viewing_vectors(view):
    return np.tile([0.0, 0.0, 0.3], (np.count_nonzero(view.valid), 1))


def test_segments_lie_along_the_profiles_of_a_surface():
    view = wavy_view()
    segments = extract_line_segments(view, viewing_vectors(view), MAX_GAP)
    assert len(segments) > 100
    np.testing.assert_allclose(np.linalg.norm(segments.directions, axis=1), 1.0)
    np.testing.assert_allclose(segments.sight, np.tile([0.0, 0.0, 1.0], (len(segments), 1)))
    # between the first and the last point of a profile
    low, high = (pick(view.cloud(), axis=0) for pick in (np.min, np.max))
    inside = (segments.points_xyz > low - 1e-9) & (segments.points_xyz < high + 1e-9)
    assert inside.all()


def test_points_over_a_gap_make_no_segment():
    view = wavy_view()
    assert not len(extract_line_segments(view, viewing_vectors(view), 1e-6))


def test_segments_on_a_surfel_are_left_out_and_those_of_a_wall_are_not():
    view = wavy_view()
    surfels = fit_surfels(downsample(view, EDGE), EDGE)
    segments = extract_line_segments(view, viewing_vectors(view), MAX_GAP)
    assert len(segments.without_surfels(surfels, EDGE)) < 0.1 * len(segments)
    lifted = np.eye(4)
    lifted[2, 3] = 3e-3
    raised = segments.transformed(lifted)
    assert len(raised.without_surfels(surfels, EDGE)) == len(segments)
    along = type(segments)(
        points_xyz=segments.points_xyz,
        directions=np.tile([0.0, 0.0, 1.0], (len(segments), 1)),
        sight=segments.sight,
        sigma=segments.sigma,
    )
    assert len(along.without_surfels(surfels, EDGE)) > 0.9 * len(segments)


def test_empty_view_has_no_segments():
    view = empty(wavy_view())
    assert not len(extract_line_segments(view, np.empty((0, 3)), MAX_GAP))
