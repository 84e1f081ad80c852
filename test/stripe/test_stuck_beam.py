# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest

from ivfmc_ros.model import Frame
from ivfmc_ros.model import Profile
from ivfmc_ros.stripe.stuck_beam import remaining_light
from ivfmc_ros.stripe.stuck_beam import StuckBeamCheck

HEIGHT, WIDTH = 120, 160
COLUMN = 80.0


def image_of(peak, seed, ambient=20.0, edge=0.0):
    """Return an image with a stripe, and ambient light that is brighter right of the stripe."""
    columns = np.arange(WIDTH)
    light = np.full((HEIGHT, WIDTH), ambient) + edge * (columns > COLUMN)
    light += peak * np.exp(-0.5 * ((columns - COLUMN) / 2.5) ** 2)
    noise = np.random.default_rng(seed).normal(0.0, 2.0, light.shape)
    return np.clip(light + noise, 0, 255).astype(np.uint8)


def profile_of(rows=HEIGHT, angle=0.5, laser=0):
    uv = np.column_stack([np.full(rows, COLUMN), np.arange(rows, dtype=float)])
    return Profile(
        points_xyz=np.zeros((rows, 3)),
        intensity=np.full(rows, 100.0),
        sigma=np.full(rows, 1e-5),
        uv=uv,
        angle=angle,
        laser=laser,
        view=laser,
        seq=0,
        stamp_ns=0,
    )


def check_after(profile, *dark, angle=0.5, peak=100.0, period=0.6, **light):
    check = StuckBeamCheck()
    frame = Frame(
        image=image_of(peak, 1, **light), stamp_ns=0, angle=profile.angle, laser=profile.laser
    )
    check.add_lit(frame, profile)
    for number, image in enumerate(dark, start=1):
        check.add_dark(image, angle, round(number * period * 1e9))
    return check


@pytest.mark.parametrize('edge', [0.0, 40.0])
def test_laser_that_is_off_is_not_stuck(edge):
    dark = [image_of(0.0, seed, edge=edge) for seed in range(2, 6)]
    check = check_after(profile_of(), *dark, edge=edge)
    assert check.stuck is None
    assert check.checked == 4


@pytest.mark.parametrize('peak', [100.0, 40.0])
def test_laser_that_shines_on_for_a_second_is_stuck(peak):
    shining = [image_of(peak, seed) for seed in (2, 3, 4)]
    check = check_after(profile_of(laser=1), *shining)
    assert check.stuck == 1
    assert check.dark_ns == 0


def test_images_that_are_stamped_late_show_the_beam_for_some_time():
    shining = [image_of(100.0, seed) for seed in range(2, 10)]
    check = check_after(profile_of(), *shining, image_of(0.0, 11), period=0.1)
    assert check.stuck is None
    assert check.dark_ns == 900_000_000


def test_laser_that_is_repaired_is_not_stuck_any_more():
    shining = [image_of(100.0, seed) for seed in (2, 3, 4)]
    check = check_after(profile_of(), *shining, image_of(0.0, 5))
    assert check.stuck is None


@pytest.mark.parametrize('angle', [0.6, math.nan])
def test_image_of_another_angle_is_not_compared(angle):
    shining = [image_of(100.0, seed) for seed in (2, 3, 4)]
    check = check_after(profile_of(), *shining, angle=angle)
    assert check.stuck is None
    assert check.checked == 0
    # what cannot be judged delays no scan
    assert check.dark_ns > 0


def test_angle_is_compared_without_whole_turns():
    shining = [image_of(100.0, seed) for seed in (2, 3, 4)]
    assert check_after(profile_of(), *shining, angle=0.5 + 2 * math.pi).stuck == 0


@pytest.mark.parametrize(('rows', 'peak'), [(10, 100.0), (HEIGHT, 1.0)])
def test_short_or_weak_stripe_proves_nothing(rows, peak):
    uv = profile_of(rows).uv
    assert math.isnan(remaining_light(image_of(peak, 1), image_of(peak, 2), uv))


def test_stripe_along_columns_in_16_bits():
    lit, dark = (np.ascontiguousarray(image_of(p, 1).T).astype(np.uint16) * 257 for p in (90, 45))
    uv = profile_of().uv[:, ::-1]
    assert remaining_light(lit, dark, uv) == pytest.approx(0.5, abs=0.05)
