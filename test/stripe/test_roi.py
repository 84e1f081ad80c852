# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from support.synthetic import small_camera
from support.synthetic import small_cell

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.stripe.roi import RegionOfInterest
from ivfmc_ros.stripe.roi import stripe_mask

VOLUME = Volume(radius=0.03, bottom=0.01, top=0.07)


def on_sheet(cell, laser):
    """Whether the sheet is in the volume, at every pixel, without the shortcuts of the source."""
    u, v = np.meshgrid(np.arange(cell.camera.width), np.arange(cell.camera.height))
    rays = cell.camera.rays(np.stack([u.ravel(), v.ravel()], axis=1))
    base = transforms.apply(
        transforms.invert(cell.turntable.camera_from_base), cell.lasers[laser].intersect(rays)
    )
    return VOLUME.contains(base).reshape(u.shape)


@pytest.mark.parametrize('laser', [0, 1])
def test_no_pixel_of_the_volume_is_masked(laser):
    cell = small_cell(small_camera(distortion=np.array([-0.3, 0.1, 0, 0, 0])))
    inside = on_sheet(cell, laser)
    mask = stripe_mask(cell, laser, VOLUME)
    assert mask.shape == (512, 640)
    assert mask.dtype == bool
    assert inside.sum() > 1000
    assert mask[inside].all()


def test_little_more_than_the_volume_is_looked_at():
    inside = on_sheet(small_cell(), 0)
    mask = stripe_mask(small_cell(), 0, VOLUME)
    rows, columns = np.nonzero(inside)
    more_rows, more_columns = np.nonzero(mask)
    assert rows.min() - more_rows.min() <= 12
    assert more_rows.max() - rows.max() <= 12
    assert columns.min() - more_columns.min() <= 12
    assert more_columns.max() - columns.max() <= 12


def test_volume_that_the_sheet_does_not_cross_is_all_masked():
    high = Volume(radius=0.01, bottom=5.0, top=6.0)
    assert not stripe_mask(small_cell(), 0, high).any()


@pytest.mark.parametrize(
    ('direction', 'reach', 'rows', 'columns'),
    [
        ('rows', 5, (20, 31), (35, 56)),
        ('rows', 50, (20, 31), (0, 80)),
        ('columns', 5, (15, 36), (40, 51)),
        ('columns', 25, (0, 50), (40, 51)),
    ],
)
def test_window_holds_the_region_and_its_surroundings_across(direction, reach, rows, columns):
    mask = np.zeros((50, 80), dtype=bool)
    mask[[20, 25, 30], [40, 45, 50]] = True
    window = RegionOfInterest.of(mask).window(direction, reach)
    assert window == (slice(*rows), slice(*columns))
