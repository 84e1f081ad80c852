# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Points of a cylinder measured with random calibration errors, for coverage of intervals."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.inspection import features
from ivfmc_ros.inspection.uncertainty import calibration_modes
from ivfmc_ros.simulation.bench import bench_cell

RADIUS = 0.02
NOISE = 0.02e-3
# 1 sigma, meters and radians: translation and rotation of the axis; normal and offset of a laser
# plane
POSE = np.array([0.02e-3, 0.02e-3, 0.05e-3, 1e-4, 1e-4, 1e-4])
PLANE = np.array([1e-4, 1e-4, 1e-4, 0.03e-3])


def stated_cell() -> Cell:
    """Return the bench cell with the covariances of a typical calibration."""
    cell = bench_cell()
    lasers = []
    for laser in cell.lasers:
        across = np.eye(4)
        across[:3, :3] -= np.outer(laser.normal, laser.normal)
        lasers.append(replace(laser, covariance=across @ np.diag(PLANE**2) @ across.T))
    turntable = replace(cell.turntable, covariance=np.diag(POSE**2))
    return replace(cell, turntable=turntable, lasers=tuple(lasers))


def with_random_errors(cell: Cell, rng: np.random.Generator) -> Cell:
    """Return a cell with calibration errors drawn from its covariances."""
    step = rng.multivariate_normal(np.zeros(6), cell.turntable.covariance)
    T = cell.turntable.camera_from_base
    turned = Rotation.from_rotvec(step[3:]).as_matrix() @ T[:3, :3]
    lasers = []
    for laser in cell.lasers:
        move = rng.multivariate_normal(np.zeros(4), laser.covariance)
        normal = laser.normal + move[:3]
        size = np.linalg.norm(normal)
        lasers.append(
            replace(laser, normal=normal / size, offset=float((laser.offset + move[3]) / size))
        )
    pose = transforms.rigid(turned, T[:3, 3] + step[:3])
    return replace(
        cell, turntable=replace(cell.turntable, camera_from_base=pose), lasers=tuple(lasers)
    )


def measured(true: Cell, believed: Cell, rng: np.random.Generator) -> np.ndarray:
    """Return points on a cylinder, measured by one cell and triangulated with another."""
    points = []
    for index, azimuth in enumerate((np.radians(36.0), np.radians(-30.0))):
        laser = true.lasers[index]
        for angle in np.linspace(0, 2 * np.pi, 40, endpoint=False):
            height = np.linspace(0.01, 0.07, 15)
            base = np.stack(
                [
                    np.full(15, RADIUS * np.cos(azimuth)),
                    np.full(15, RADIUS * np.sin(azimuth)),
                    height,
                ],
                axis=1,
            )
            # on the cylinder and in the light sheet, which is vertical and contains the axis
            camera = transforms.apply(true.turntable.camera_from_base, base)
            assert np.abs(laser.distance(camera)).max() < 1e-9
            seen = believed.lasers[index].intersect(camera / camera[:, 2:])
            points.append(believed.turntable.to_part(seen, float(angle)))
    cloud = np.concatenate(points)
    return cloud + rng.normal(scale=NOISE, size=cloud.shape)


def coverage(cells: int, seed: int) -> tuple[int, float]:
    """Return how many 95 % intervals contain the true diameter, and their median width, meters."""
    rng = np.random.default_rng(seed)
    true, covered, widths = stated_cell(), 0, []
    for _ in range(cells):
        believed = with_random_errors(true, rng)
        points = measured(true, believed, rng)
        found = features.fit('cylinder', points)
        normals = points - found.center_xyz
        normals -= (normals @ found.axis)[:, None] * found.axis
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        modes = calibration_modes(believed, points, normals)
        calibration = modes.propagate(lambda p: features.fit('cylinder', p).diameter, points)
        u = np.hypot(calibration, 2 * found.rms / np.sqrt(len(points)))
        covered += abs(found.diameter - 2 * RADIUS) <= 1.96 * u
        widths.append(2 * 1.96 * u)
    return int(covered), float(np.median(widths))
