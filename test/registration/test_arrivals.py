# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import dataclass

from support.surfaces import wavy_view

from ivfmc_ros.registration.arrivals import Arrivals


@dataclass
class Profile:
    """A profile with nothing but the number of its view."""

    view: int


def fed(arrivals, *views):
    """Return what ``add`` returns for profiles of these views."""
    return [arrivals.add(Profile(view)) for view in views]


def test_view_is_complete_when_none_of_the_last_profiles_belongs_to_it():
    arrivals = Arrivals()
    # lasers that take turns do not end each other's views
    assert not any(fed(arrivals, *[0, 1] * 10))
    assert fed(arrivals, *[2] * 5) == [False] * 4 + [True]
    assert [profile.view for profile in arrivals.next()] == [0] * 10
    assert arrivals.next() == []


def test_registration_begins_once_at_a_time_and_only_with_a_complete_view():
    arrivals = Arrivals()
    assert not arrivals.begin()
    fed(arrivals, 0, *[1] * 6)
    assert arrivals.begin()
    assert not arrivals.begin()
    arrivals.end()
    assert arrivals.begin()


def test_a_registered_view_has_a_pose_and_takes_no_more_profiles():
    arrivals = Arrivals()
    fed(arrivals, 0, *[1] * 6)
    arrivals.next()
    arrivals.place([wavy_view(0)])
    assert set(arrivals.poses) == {0}
    fed(arrivals, 0, *[1] * 6)
    assert arrivals.next() == []
