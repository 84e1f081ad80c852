# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import time

import numpy as np

from ivfmc_ros.devices.cameras.device import CameraImage
from ivfmc_ros.devices.cameras.frame_watch import FrameWatch

PERIOD = 0.1


def noise(seed):
    return np.random.default_rng(seed).integers(0, 9, (64, 48)).astype(np.uint8)


def picture(image, age=0.0):
    return CameraImage(image=image, stamp_ns=time.time_ns() - int(age * 1e9))


def watch_all(images, gaps=None):
    watch, now = FrameWatch(), 0.0
    for index, image in enumerate(images):
        now += (gaps or {}).get(index, PERIOD)
        assert watch.accepts(picture(image), PERIOD, now)
    return watch


def test_images_with_noise_are_fine():
    watch = watch_all([noise(seed) for seed in range(20)])
    assert watch.fault == ''
    assert set(watch.counts.values()) == {0}


def test_equal_images_are_a_frozen_camera_until_another_comes():
    watch = watch_all([noise(0)] * 5)
    assert 'frozen' in watch.fault
    assert watch.counts['frozen'] == 4
    assert watch.accepts(picture(noise(1)), PERIOD, 1.0)
    assert watch.fault == ''


def test_dark_images_without_noise_are_not_frozen():
    assert watch_all([np.zeros((64, 48), np.uint8)] * 9).fault == ''


def test_image_with_the_stamp_of_the_one_before_is_dropped():
    watch = FrameWatch()
    first = picture(noise(0))
    assert watch.accepts(first, PERIOD, 0.0)
    assert not watch.accepts(first, PERIOD, 0.1)
    assert watch.counts['repeated'] == 1


def test_camera_goes_on_when_the_clock_is_set_back_by_an_hour():
    # its images were dropped as repeated until the hour was over
    watch = FrameWatch()
    assert watch.accepts(picture(noise(0)), PERIOD, 0.0)
    before = picture(noise(1), age=3600.0)
    assert watch.accepts(before, PERIOD, 0.1)
    assert watch.counts['repeated'] == 0
    assert not watch.accepts(before, PERIOD, 0.2)


def test_gap_counts_the_images_that_are_missing():
    images = [noise(seed) for seed in range(4)]
    assert watch_all(images, {2: 4 * PERIOD}).counts['missing'] == 3


def test_image_that_was_taken_long_ago_is_late():
    watch = FrameWatch()
    assert watch.accepts(picture(noise(0), age=0.8), PERIOD, 0.0)
    assert watch.counts['late'] == 1
