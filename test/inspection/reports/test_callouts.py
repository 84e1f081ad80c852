# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from itertools import combinations

from hypothesis import given
from hypothesis import settings
from hypothesis import strategies as st
import pytest

from ivfmc_ros.inspection.reports.callouts import _intersect
from ivfmc_ros.inspection.reports.callouts import LABEL_HEIGHT
from ivfmc_ros.inspection.reports.callouts import LABEL_WIDTH
from ivfmc_ros.inspection.reports.callouts import MARGIN
from ivfmc_ros.inspection.reports.callouts import place_callouts

SIZE = (430, 400)
ROOM = 2 * int(SIZE[1] // (LABEL_HEIGHT + 4))
PLACES = st.lists(
    st.tuples(st.floats(0, SIZE[0] - 1), st.floats(0, SIZE[1] - 1)), unique=True, max_size=60
)


@settings(max_examples=80, deadline=None)
@given(PLACES)
def test_labels_lie_beside_the_picture_and_do_not_overlap(places):
    callouts = place_callouts(list(enumerate(places)), SIZE)
    assert {callout.number for callout in callouts} == set(range(min(len(places), ROOM)))
    for callout in callouts:
        x, y = callout.center
        assert LABEL_HEIGHT / 2 <= y <= SIZE[1] - LABEL_HEIGHT / 2
        assert x + LABEL_WIDTH / 2 < MARGIN or x - LABEL_WIDTH / 2 > MARGIN + SIZE[0]
        assert callout.anchor == pytest.approx(
            (places[callout.number][0] + MARGIN, places[callout.number][1])
        )
    for one, other in combinations(callouts, 2):
        apart = abs(one.center[1] - other.center[1]) >= LABEL_HEIGHT
        assert apart or abs(one.center[0] - other.center[0]) > SIZE[0]


@settings(max_examples=80, deadline=None)
@given(PLACES)
def test_leader_lines_of_a_side_do_not_cross(places):
    callouts = place_callouts(list(enumerate(places)), SIZE)
    for one, other in combinations(callouts, 2):
        if one.center[0] == other.center[0]:
            assert not _intersect(one.leader, other.leader)


def test_first_ones_are_named_where_there_is_little_room():
    places = [(7 * k % 430, 13 * k % 400) for k in range(100)]
    named = {callout.number for callout in place_callouts(list(enumerate(places)), SIZE)}
    assert named == set(range(ROOM))
