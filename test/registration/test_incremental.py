# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
import time

import numpy as np
import pytest
from support.surfaces import empty
from support.surfaces import moved
from support.surfaces import slip
from support.surfaces import wavy_view

from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.registration.incremental import IncrementalRegistration


def scan(count):
    """Views that overlap by half; from the third on the part has slipped, and stays so."""
    views = [wavy_view(number, offset=1.3e-3 * number) for number in range(count)]
    return [moved(view, slip()) if view.number >= 2 else view for view in views]


def test_views_are_registered_as_they_come():
    registration = IncrementalRegistration()
    verdicts = [registration.add(view) for view in scan(4)]
    assert [verdict.why for verdict in verdicts[::2]] == ['reference', 'moved']
    assert [verdict.view for verdict in verdicts] == [0, 1, 2, 3]
    corner = np.array([[0.02, 0.02, 0.0]])
    for number, true in enumerate((np.eye(4), np.eye(4), slip(), slip())):
        found = transforms.apply(registration.poses[number] @ true, corner)
        assert np.abs(found - corner).max() < 2e-5, number


def test_a_view_takes_milliseconds():
    registration = IncrementalRegistration()
    views = scan(4)
    for view in views[:3]:
        registration.add(view)
    begin = time.process_time()
    registration.add(views[3])
    assert time.process_time() - begin < 1.0


def test_view_without_surface_is_reported_and_ignored():
    registration = IncrementalRegistration()
    views = scan(3)
    assert registration.add(replace(empty(views[0]), number=9)).why == 'reference'
    assert registration.add(views[0]).why == 'reference'
    verdict = registration.add(replace(empty(views[1]), number=8))
    assert (verdict.applied, verdict.why) == (False, 'not checked: only 0 surfels')
    assert registration.add(views[2]).applied


def test_view_elsewhere_is_not_moved():
    registration = IncrementalRegistration()
    registration.add(wavy_view(0))
    away = moved(wavy_view(1), transforms.rigid(np.eye(3), (0.5, 0.0, 0.0)))
    verdict = registration.add(away)
    assert verdict.why == 'not checked: overlaps with no other view'
    np.testing.assert_array_equal(registration.poses[1], np.eye(4))


def test_points_beyond_100_m_are_refused():
    far = moved(wavy_view(0), transforms.rigid(np.eye(3), (1e4, 0.0, 0.0)))
    with pytest.raises(GeometryError, match='view 0: has points farther than 100 m'):
        IncrementalRegistration().add(far)
