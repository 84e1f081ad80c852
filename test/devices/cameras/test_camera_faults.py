# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import time

import pytest
from support.camera_faults import CAMERA_FAULTS
from support.camera_faults import camera_outcome
from support.camera_faults import capturing


@pytest.mark.parametrize('fault', CAMERA_FAULTS, ids=lambda fault: fault.name)
def test_fault_is_said_within_two_seconds_and_the_next_image_works(fault, tmp_path):
    found = camera_outcome(fault, tmp_path)
    assert fault.said in found.text
    assert found.said_s < 2.0
    # a frozen camera sends on; its images are a fault, and one with another exposure is a warning
    assert bool(found.images) == (fault.name == 'frozen' or fault.is_warning)
    assert found.recovered_s < 3.0


def test_camera_that_is_plugged_in_later_is_no_other_one(tmp_path):
    with capturing(tmp_path) as (camera, capture):
        capture.stop()
        camera.unplug()
        # a driver that starts without its camera
        capture._camera._serial = None
        capture.start()
        time.sleep(0.2)
        assert 'cannot be opened' in capture.fault
        camera.plug('A1')
        known, end = capture.image_count, time.monotonic() + 5.0
        while capture.image_count == known and time.monotonic() < end:
            time.sleep(0.01)
        assert capture.fault == ''


def test_images_that_are_missing_are_counted_by_the_steady_clock(tmp_path):
    with capturing(tmp_path) as (camera, capture):
        camera.delivers.clear()
        time.sleep(0.6)
        camera.delivers.set()
        time.sleep(0.3)
        # 25 a second
        assert 5 <= capture.counts['missing'] <= 40
        assert capture.counts['repeated'] == 0
