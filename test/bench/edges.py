# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rendered sweeps over a step edge and over a border of reflectance, with the true outline."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.model import Frame
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.bench import LASER_AZIMUTHS
from ivfmc_ros.simulation.parts.prism import Layer
from ivfmc_ros.simulation.parts.prism import stack
from ivfmc_ros.simulation.render.optics import expose
from ivfmc_ros.simulation.render.optics import Optics
from ivfmc_ros.simulation.render.renderer import StripeRenderer
from ivfmc_ros.simulation.render.scene import part_from_camera
from ivfmc_ros.simulation.render.scene import Scene

HEIGHT = 0.05  # meters
STEP = np.radians(0.1)  # between frames
FRAMES = 61
BLACK = 0.1  # reflectance
NEAR = 1.5e-3  # meters from the edge within which a point counts
_SAMPLES = 3  # per pixel, of the black-white border

_FRONT, _BACK, _HALF = 0.020, -0.02, 0.025
SQUARE = np.array([(_BACK, -_HALF), (_FRONT, -_HALF), (_FRONT, _HALF), (_BACK, _HALF)])
STEPPED = np.array(
    [
        (_BACK, -_HALF),
        (_FRONT, -_HALF),
        (_FRONT, 0.0),
        (_FRONT - 0.003, 0.0),
        (_FRONT - 0.003, _HALF),
        (_BACK, _HALF),
    ]
)


@dataclass(frozen=True, eq=False)
class Edge:
    """
    A sweep over a vertical edge at y = 0 of the part.

    outline : (n, 2) meters, of the block
    frames : images of the sweep
    around : 16 images of a whole turn
    """

    cell: object
    outline: np.ndarray
    frames: list[Frame]
    around: list[Frame]

    def errors(self, profiles):
        """Return the distances (meters) of all points near the edge from the block."""
        points = np.concatenate([profile.points_xyz for profile in profiles])
        inside = (points[:, 2] > 0.004) & (points[:, 2] < HEIGHT - 0.004)
        near = inside & (np.abs(points[:, 1]) < NEAR) & (points[:, 0] > 0)
        return distances(points[near, :2], self.outline)


def distances(points, outline):
    """Return (n,) distances of (n, 2) points from a closed outline."""
    start, along = outline, np.roll(outline, -1, axis=0) - outline
    offset = points[:, None] - start
    part = np.clip((offset * along).sum(axis=2) / (along**2).sum(axis=1), 0, 1)
    return np.linalg.norm(offset - part[..., None] * along, axis=2).min(axis=1)


def sweep(kind, optics=None):
    """Return the sweep over a 'step' or a reflectance 'border'."""
    optics = optics or Optics()
    cell = bench_cell(np.zeros(5))
    outline = STEPPED if kind == 'step' else SQUARE
    solid = stack([Layer(low=0.0, high=HEIGHT, bottom=[outline])])
    renderer = StripeRenderer(cell=cell, solid=solid, optics=optics)
    scene = Scene(solid, None, 1.0)

    def render(seq, angle):
        light = renderer.light(angle, 0)
        if kind == 'border':
            light = light * albedo(cell, scene, angle, light > 0)
        image = expose(optics.ambient, light, optics, np.random.default_rng((7, seq)))
        return Frame(image=image, stamp_ns=seq, angle=angle, seq=seq)

    middle = LASER_AZIMUTHS['left']
    return Edge(
        cell=cell,
        outline=outline,
        frames=[render(seq, middle + (seq - FRAMES // 2) * STEP) for seq in range(FRAMES)],
        around=[render(seq, seq * np.pi / 8) for seq in range(16)],
    )


def albedo(cell, scene, angle, lit):
    """Return the mean reflectance of lit pixels: 1 where y < 0 on the part, else BLACK."""
    rows, columns = np.nonzero(lit)
    pose = part_from_camera(cell.turntable.camera_from_base, angle)
    white = np.zeros(len(rows))
    for shift in (np.arange(_SAMPLES) + 0.5) / _SAMPLES - 0.5:
        directions = cell.camera.rays(np.stack([columns + shift, rows], axis=1)) @ pose[:3, :3].T
        lengths, _ = scene.cast(pose[:3, 3], directions)
        with np.errstate(invalid='ignore'):
            white += (pose[1, 3] + lengths * directions[:, 1]) < 0
    result = np.ones(lit.shape, dtype=np.float32)
    result[rows, columns] = BLACK + (1 - BLACK) * white / _SAMPLES
    return result
