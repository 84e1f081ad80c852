# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated scans of one part in different clampings on the table."""

import numpy as np
from scipy.spatial.transform import Rotation

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Poses
from ivfmc_ros.registration.merge.bodies import Clamping
from support.erring_table import stripes
from support.erring_table import turns
from support.erring_table import views_of


def lying(part, seed):
    """Return a random turntable_from_part, (4, 4), of a part that lies on its side."""
    rng = np.random.default_rng((12, seed))
    roll, azimuth = rng.uniform(0.0, 2.0 * np.pi, 2)
    turn = Rotation.from_euler('zyz', (roll, np.pi / 2, azimuth))
    return settled(part, turn, rng.uniform(-0.004, 0.004, 2))


def settled(part, turn, aside=(0.0, 0.0)):
    """Return turntable_from_part of a turned part whose lowest point touches the platter."""
    vertices = turn.apply(part.vertices_xyz)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    return transforms.rigid(turn.as_matrix(), (*(aside - (low + high)[:2] / 2), -low[2]))


def clamped(name, cell, part, T, steps=100, seed=1, measure=stripes):
    """
    Return a scan of a part at T (turntable_from_part).

    T : (4, 4); steps : table angles per turn
    measure : function that returns the stripes; by default exact ones with noise
    """
    sweeps = turns(steps, np.zeros_like)
    measured = measure(cell, part.moved(T), sweeps, seed)
    views = views_of(cell, measured, sweeps)
    return Clamping(name=name, cell=cell, views=views, poses=Poses.identity(len(views)))


def displacement(part, found, true):
    """Return the greatest distance in meters between a point of the part at two poses."""
    vertices = part.vertices_xyz
    return float(
        np.linalg.norm(
            transforms.apply(found, vertices) - transforms.apply(true, vertices), axis=1
        ).max()
    )
