# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from support.synthetic import draw_stripe
from support.synthetic import expose
from support.synthetic import small_cell
from support.synthetic import Sphere

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import Frame
from ivfmc_ros.stripe.acquisition import Acquisition
from ivfmc_ros.stripe.acquisition import AcquisitionSettings
from ivfmc_ros.stripe.space_time_stream import create_stream
from ivfmc_ros.stripe.space_time_stream import SpaceTimeAcquisition
from ivfmc_ros.stripe.stream import StreamAcquisition

SPHERE = Sphere(np.array([0.01, 0.005, 0.04]), 0.02)
STEPS = 12
HALF = 4


@pytest.fixture(scope='module')
def frames():
    rng = np.random.default_rng(1)
    angles = np.radians(0.2) * np.arange(STEPS)
    images = [expose(draw_stripe(SPHERE.stripe(small_cell(), angle)), rng) for angle in angles]
    return [
        Frame(image=image, stamp_ns=seq, angle=angle, view=3, seq=seq)
        for seq, (image, angle) in enumerate(zip(images, angles, strict=True))
    ]


def followed(frames, sampled=5):
    stream = SpaceTimeAcquisition(
        Acquisition(small_cell(), AcquisitionSettings(space_time=HALF)), sampled
    )
    come = [stream.add(frame) for frame in frames]
    rest = stream.flush()
    assert stream.flush() == []
    return stream, come, rest


def test_each_picture_is_measured_once_when_those_after_it_have_come(frames):
    stream, come, rest = followed(frames)
    assert [len(pairs) for pairs in come] == [0] * 4 + [1] * 8
    seqs = [frame.seq for pairs in (*come, rest) for frame, _ in pairs]
    assert seqs == [frame.seq for frame in frames]
    assert stream.acquisition.counts.pictures == STEPS


def test_every_point_is_counted_once(frames):
    stream, come, rest = followed(frames)
    profiles = [profile for pairs in (*come, rest) for _, profile in pairs]
    counts = stream.acquisition.counts
    gone = counts.unconfirmed + counts.outside_volume + counts.noise
    assert sum(map(len, profiles)) == counts.stripe_points - gone
    middle = profiles[STEPS // 2]
    assert len(middle) > 50
    assert np.sqrt(np.mean(SPHERE.distance(middle.points_xyz) ** 2)) < 0.1e-3


def test_pictures_of_another_view_are_not_followed_into(frames):
    other = [replace(frame, view=4, seq=frame.seq + STEPS) for frame in frames]
    _, come, rest = followed([*frames, *other])
    together = [profile for pairs in (*come, rest) for _, profile in pairs]
    _, come, rest = followed(frames)
    alone = [profile for pairs in (*come, rest) for _, profile in pairs]
    assert [profile.seq for profile in together] == list(range(2 * STEPS))
    for one, two in zip(alone, together, strict=False):
        assert np.array_equal(one.points_xyz, two.points_xyz)


def test_steps_in_which_nothing_is_confirmed_are_refused(frames):
    with pytest.raises(GeometryError, match=r'^space_time: none of \d+ stripe points is seen in'):
        followed(frames[:2])


@pytest.mark.parametrize(('half', 'kind'), [(0, StreamAcquisition), (8, SpaceTimeAcquisition)])
def test_settings_say_whether_points_are_followed(half, kind):
    acquisition = Acquisition(small_cell(), AcquisitionSettings(space_time=half))
    assert isinstance(create_stream(acquisition), kind)
