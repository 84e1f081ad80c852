# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
from support.synthetic import small_cell
from support.synthetic import Sphere
from support.synthetic import sphere_profiles

from ivfmc_ros.inspection.reports.registration_maps import registration_maps
from ivfmc_ros.meshing.paper.range_mesh import range_mesh
from ivfmc_ros.model import Poses
from ivfmc_ros.registration.views.assemble import assemble


def scanned():
    cell = small_cell()
    (view,) = assemble(cell, sphere_profiles(cell, Sphere(np.array([0.0, 0.0, 0.04]), 0.02), 40))
    return range_mesh(cell, view, 6e-3), view


def shifted(view, shift):
    """A view that the table placed wrong by ``shift``, and the pose that corrects it."""
    T = np.eye(4)
    T[:3, 3] = shift
    moved = replace(view, points_xyz=view.points_xyz - T[:3, 3])
    return moved, Poses(turntable_from_view=np.stack([np.eye(4), T]))


def within_of(caption):
    return float(caption.split()[-2])


def test_difference_that_registration_makes_is_seen_and_stated():
    mesh, view = scanned()
    moved, poses = shifted(view, (3e-4, 0.0, 0.0))
    (before, first, bar), (after, second, other) = registration_maps(mesh, [view, moved], poses)
    assert bar == other
    assert bar.high < 3.1e-4
    assert first.startswith('before registration')
    assert 'up to 0.3000 mm' in second
    assert within_of(second) < 1e-3
    assert 0.2 < within_of(first) <= 0.3
    # green is no distance; what is wrong before is of another color
    strong = [
        (np.abs(picture.astype(int) - (102, 199, 115)).max(axis=2) > 60) & (picture < 245).any(2)
        for picture in (before, after)
    ]
    assert strong[0].sum() > 20 * max(strong[1].sum(), 1)


def test_poses_that_were_kept_are_one_picture():
    mesh, view = scanned()
    ((picture, caption, bar),) = registration_maps(mesh, [view, view], Poses.identity(2))
    assert 'poses of the table were kept' in caption
    assert bar is None
    assert (picture < 245).any(axis=2).sum() > 1000


def test_scan_without_points_has_no_map():
    mesh, _ = scanned()
    assert registration_maps(mesh, [], Poses.identity(0)) == []
