# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A synthetic view of a wavy surface in closed form, and displaced and empty versions of it."""

from dataclasses import replace

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import View
from ivfmc_ros.registration.views.assemble import without


def wavy_view(number=0, rows=120, columns=150, offset=0.0):
    """Return a view of a surface that is curved in all directions, sampled every 0.4 mm."""
    along = np.arange(rows) * 4e-4 + offset, np.arange(columns) * 4e-4 + 0.7 * offset
    y, x = np.meshgrid(*along, indexing='ij')
    z = 4e-3 * np.sin(x / 7e-3) * np.cos(y / 9e-3) + 2e-3 * np.sin(y / 5e-3 + 1.0)
    points = np.stack([x - 0.03, y - 0.024, z], axis=2)
    ones = np.ones((rows, columns))
    return View(
        number=number,
        laser=0,
        points_xyz=points,
        intensity=100 * ones,
        sigma=1e-5 * ones,
        uv=np.repeat(ones[..., None], 2, axis=2),
        angles=np.linspace(0.0, 1.0, columns),
        seqs=np.arange(columns),
    )


def moved(view, T):
    """Return the view transformed by the (4, 4) pose ``T``."""
    return replace(view, points_xyz=transforms.apply(T, view.points_xyz))


def slip(degrees=0.4, millimeters=0.3):
    """Return the (4, 4) pose of a part that slipped on the table: a turn about z and a shift."""
    shift = 1e-3 * millimeters * np.array([0.6, -0.8, 0.0])
    return transforms.rigid(transforms.rotation_z(np.radians(degrees)), shift)


def empty(view):
    """Return the view without any point."""
    return without(view, np.ones(view.valid.shape, dtype=bool))
