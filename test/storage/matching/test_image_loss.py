# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import pytest

from ivfmc_ros.storage.matching.image_loss import ImageLoss

START = 1_700_000_000_000_000_000
PERIOD = 50_000_000


def counted(images, infos):
    loss = ImageLoss()
    for number in range(max([*images, *infos]) + 1):
        if number in infos:
            loss.add_info(START + number * PERIOD)
        if number in images:
            loss.add_image(START + number * PERIOD)
    loss.finish()
    return loss.not_received, loss.not_taken


def test_no_image_is_lost_where_every_one_is_received():
    assert counted(range(100), range(100)) == (0, 0)


def test_image_without_its_message_is_counted_by_its_camera_info():
    assert counted(set(range(100)) - {40, 41, 70}, range(100)) == (3, 0)


def test_camera_that_stands_still_is_counted_by_the_frame_rate():
    left = set(range(100)) - set(range(40, 72))
    assert counted(left, left) == (0, 32)


def test_images_without_camera_info_are_counted_by_the_frame_rate():
    assert counted(set(range(100)) - {40, 41, 70}, []) == (0, 3)


def test_camera_info_of_other_stamps_than_its_images_is_no_loss():
    loss = ImageLoss()
    for number in range(100):
        loss.add_info(START + number * PERIOD + 1000)
        loss.add_image(START + number * PERIOD)
    loss.finish()
    assert loss.total == 0


def test_image_that_is_received_after_its_successors_is_not_lost():
    loss = ImageLoss()
    for number in [*range(20), 25, 20, 21, 24, 22, 23, *range(26, 100)]:
        loss.add_info(START + number * PERIOD)
        loss.add_image(START + number * PERIOD)
    loss.finish()
    assert loss.total == 0


def test_images_that_wait_in_a_queue_for_seconds_are_not_lost():
    loss = ImageLoss()
    lost = (40, 70)
    for number in range(100):
        loss.add_info(START + number * PERIOD)
        # 2 s behind its camera_info
        if number >= 40 and number - 40 not in lost:
            loss.add_image(START + (number - 40) * PERIOD)
    for number in set(range(60, 100)) - set(lost):
        loss.add_image(START + number * PERIOD)
    loss.finish()
    assert (loss.not_received, loss.not_taken) == (2, 0)


@pytest.mark.parametrize('change_s', [-3600, 3600])
def test_jump_of_the_clock_or_a_stopped_camera_loses_no_image(change_s):
    loss = ImageLoss()
    for change in (0, change_s):
        for number in range(60):
            stamp = START + change * 1_000_000_000 + number * PERIOD
            loss.add_info(stamp)
            loss.add_image(stamp)
    loss.finish()
    assert loss.total == 0


def test_jitter_of_the_frame_rate_loses_no_image():
    loss = ImageLoss()
    for number in range(100):
        loss.add_image(START + number * PERIOD + (number % 3) * 8_000_000)
    loss.finish()
    assert loss.total == 0
