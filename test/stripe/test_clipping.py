# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Surface that goes on beyond the working volume is said, with the volume that would hold it."""

import numpy as np
import pytest
from support.synthetic import small_cell
from support.synthetic import Sphere
from support.synthetic import sphere_frames

from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.pipeline import reconstruct
from ivfmc_ros.pipeline import Settings
from ivfmc_ros.stripe.acquisition import Acquisition
from ivfmc_ros.stripe.acquisition import AcquisitionSettings
from ivfmc_ros.stripe.clipping import find_cuts

SPHERE = Sphere(np.array([0.004, 0.002, 0.04]), 0.03)
FRAMES = sphere_frames(small_cell(), SPHERE, 24, seed=1)
# of the sphere, meters
RADIUS, TOP = 0.0345, 0.070


def clipping(**volume):
    acquisition = Acquisition(small_cell(), AcquisitionSettings(volume=Volume(**volume)))
    for frame in FRAMES:
        acquisition.profile(frame)
    return acquisition.clipping_with_extent()


def test_part_that_fits_is_not_said_to_be_cut():
    assert clipping(radius=0.06, top=0.1) is None


def test_part_that_is_cut_at_the_radius_is_said_with_the_radius_that_holds_it():
    found = clipping(radius=0.025)
    assert found.pictures_radius > 12
    assert found.pictures_top == 0
    assert found.radius == pytest.approx(RADIUS, abs=0.003)
    assert found.top is None
    assert 'beyond the radius of the working volume (0.025 m)' in found.advice
    assert f'set radius to at least {found.radius:g} m' in found.advice
    assert clipping(radius=found.radius) is None


def test_part_that_is_cut_at_the_top_is_said_with_the_top_that_holds_it():
    found = clipping(top=0.055)
    assert found.radius is None
    assert found.top == pytest.approx(TOP, abs=0.003)
    assert 'set top to at least' in found.advice
    assert clipping(top=found.top) is None


def test_few_images_are_kept_of_all_that_are_cut_and_none_of_the_scan_before():
    acquisition = Acquisition(small_cell(), AcquisitionSettings(volume=Volume(radius=0.025)))
    for frame in FRAMES * 3:
        acquisition.profile(frame)
    assert acquisition.counts.cut_radius > 40
    assert acquisition.clipping_with_extent().radius == pytest.approx(RADIUS, abs=0.003)
    assert len(acquisition._cut_frames) <= 24
    assert acquisition.for_new_scan().clipping_with_extent() is None


def test_platter_beyond_the_volume_is_not_a_part_that_is_cut():
    x = np.linspace(0.0, 0.1, 200)
    points = np.stack([x, np.zeros(200), np.full(200, 1e-4)], axis=1)
    volume = Volume()
    assert find_cuts(points, volume.contains(points), volume, 2e-3) == (False, False)
    points[:, 2] = 0.01
    assert find_cuts(points, volume.contains(points), volume, 2e-3) == (True, False)


def test_cut_part_is_in_the_result_of_a_reconstruction():
    volume = AcquisitionSettings(volume=Volume(radius=0.025))
    made = reconstruct(small_cell(), FRAMES, Settings(acquisition=volume))
    assert made.clipping is not None
    assert made.clipping.pictures_radius == made.counts['cut_radius'] > 12
