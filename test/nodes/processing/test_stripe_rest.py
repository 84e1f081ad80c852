# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import math
from types import SimpleNamespace

import numpy as np
import pytest

from ivfmc_ros.model import Frame
from ivfmc_ros.nodes.processing.stripe_rest import StripeRest
from ivfmc_ros.storage.matching.frame_matching import FrameMatch
from ivfmc_ros.storage.matching.frame_matching import NOT_MEASURED
from ivfmc_ros.storage.matching.frame_matching import SAME_POSITION
from ivfmc_ros.storage.matching.laser_history import LASER_OFF

MS = 1_000_000


class Node:
    def __init__(self, motion='step'):
        self.values = {'motion': motion, 'settle': 0.1}
        self.faults = {}
        self.health = SimpleNamespace(
            set=lambda kind, subject, level, text, recovered: self.faults.update({kind: text}),
            clear=lambda kind, subject: self.faults.pop(kind, None),
        )

    def get(self, name):
        return self.values[name]


def picture(shift):
    u = np.arange(200)
    row = 10.0 + 150.0 * np.exp(-0.5 * ((u - 90.0 - shift) / 2.0) ** 2)
    noise = np.random.default_rng(round(1000 * shift)).normal(0.0, 1.0, (100, 200))
    return np.round(row + noise).astype(np.uint8)


def stop(check, number, shift, bracket=()):
    """Measure an image at a stop, and receive another one before the table moves on."""
    frame = Frame(
        image=picture(0.0), stamp_ns=number * 500 * MS, angle=0.1 * number, laser=0, view=0,
        seq=number, bracket=bracket,
    )  # fmt: skip
    check.add_measured(frame)
    check.add_unused(unused(number * 500 + 60, 0.1 * number, shift, SAME_POSITION), lambda x: x)


def unused(stamp_ms, angle, shift, reason):
    return FrameMatch(
        payload=picture(shift), stamp_ns=stamp_ms * MS, reason=reason, angle=angle, laser=0
    )


def test_stops_after_which_the_stripe_moves_are_said():
    node = Node()
    check = StripeRest(node)
    for number, shift in enumerate([0.0, 0.0, 0.6, 0.3]):
        stop(check, number, shift)
    assert 'at 2 of 4 stops the stripe moved by up to 0.6' in check.unsettled
    assert 'raise settle of the triangulator (0.1 s)' in check.unsettled
    assert list(node.faults.values()) == [check.unsettled]
    check.restart()
    assert check.unsettled == ''
    assert not node.faults


@pytest.mark.parametrize('bracket', [(), (picture(0.0),)])
def test_stripe_that_rests_or_has_several_exposures_is_no_fault(bracket):
    check = StripeRest(Node())
    for number in range(5):
        stop(check, number, 0.6 if bracket else 0.0, bracket)
    assert check.unsettled == ''


def test_continuous_motion_has_no_stops():
    check = StripeRest(Node('continuous'))
    stop(check, 0, 0.6)
    assert check.unsettled == ''


def test_rate_of_a_laser_that_waits_is_a_figure():
    check = StripeRest(Node('continuous'))
    assert check.figures['stripe_rate'] == ''
    for number in range(40):
        match = unused(100 * number, 0.0, 0.01 * number, NOT_MEASURED)
        check.add_unused(match, lambda image: image)
    figures = check.figures
    assert figures['stripe_laser'] == 0
    assert math.isclose(figures['stripe_rate'], 0.1, rel_tol=0.1)
    assert figures['stripe_rate_u'] < 0.02
    assert math.isclose(figures['stripe_seconds'], 3.8, rel_tol=0.03)


def test_not_every_image_of_a_laser_that_waits_is_decoded():
    check, decoded = StripeRest(Node('continuous')), []

    def decode(image):
        decoded.append(image)
        return image

    for number in range(60):
        check.add_unused(unused(1000 + 20 * number, 0.0, 0.0, NOT_MEASURED), decode)
    assert len(decoded) == 12


@pytest.mark.parametrize('kind', ['dark', 'measured'])
def test_rate_of_a_wait_is_forgotten_when_it_has_ended(kind):
    # the next sweep of the same laser would take it for its own, and not wait
    check = StripeRest(Node('continuous'))
    for number in range(40):
        check.add_unused(unused(100 * (number + 1), 0.0, 0.0, NOT_MEASURED), lambda image: image)
    assert check.figures['stripe_laser'] == 0
    if kind == 'dark':
        check.add_unused(unused(5000, 0.0, 0.0, LASER_OFF), lambda image: image)
    else:
        stop(check, 10, 0.0)
    assert check.figures['stripe_laser'] == ''
