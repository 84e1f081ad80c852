# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scans with known errors, and the share of an error that a correction leaves."""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.simulation.parts.loading import Solid
from ivfmc_ros.stripe.stripe import Stripe
from ivfmc_ros.surface import Surface
from support.erring_table import erring_cell
from support.erring_table import Sweep
from support.erring_table import turns
from support.erring_table import views_of
from support.rendered_stripes import Job
from support.rendered_stripes import jobs_of
from support.rendered_stripes import stripes_of

ANGLE, BACKLASH = np.radians(0.1), np.radians(0.05)
_STRIDE = 5  # of the points that are compared with the CAD


@dataclass(frozen=True, kw_only=True)
class Errors:
    """How one seed errs: the order and phase (radians) of the table's angle, and the cell."""

    seed: int
    order: int
    cell_errs: bool = True
    table_errs: bool = True

    @property
    def rng(self) -> np.random.Generator:
        return np.random.default_rng((8, self.seed))

    @cached_property
    def phase(self) -> float:
        return float(self.rng.uniform(0.0, 2.0 * np.pi))

    def of_angle(self, angles: Floats) -> Floats:
        return np.asarray(self.table_errs * ANGLE * np.cos(self.order * angles + self.phase))

    @property
    def backlash(self) -> float:
        return self.table_errs * BACKLASH

    def cell(self, cell: Cell) -> Cell:
        return erring_cell(cell, self.rng) if self.cell_errs else cell


@dataclass(frozen=True, eq=False)
class Recording:
    """A rendered two-laser scan of a part, second sweep backward, as the camera measured it."""

    cell: Cell
    part: Solid
    steps: int
    seed: int = 1

    @cached_property
    def sweeps(self) -> list[Sweep]:
        return turns(self.steps, np.zeros_like)

    @property
    def jobs(self) -> list[Job]:
        return jobs_of(self.cell, self.part, self.sweeps, self.seed)

    @cached_property
    def measured(self) -> list[list[Stripe]]:
        return [stripes_of(job) for job in self.jobs]

    @cached_property
    def nominal(self) -> Surface:
        return Surface(self.part.vertices_xyz, self.part.faces)

    @cached_property
    def perfect(self) -> float:
        """Return the rms to the CAD with a perfect cell, meters."""
        views = views_of(self.cell, self.measured, self.sweeps, true=True)
        return self.rms(views)

    def erring(self, errors: Errors) -> tuple[Cell, list[View]]:
        """Return the calibrated cell with its errors, and the views of the scan for it."""
        sweeps = [
            replace(
                sweep,
                commanded=sweep.true
                - errors.of_angle(sweep.true)
                - 0.5 * errors.backlash * (-1) ** sweep.laser,
            )
            for sweep in self.sweeps
        ]
        believed = errors.cell(self.cell)
        return believed, views_of(believed, self.measured, sweeps)

    def truth(self, believed: Cell, errors: Errors, height: float) -> dict[str, float]:
        """Return by name the errors of the believed cell and of the table."""
        base = believed.turntable.camera_from_base
        middle = np.array([0.0, 0.0, height])
        error = transforms.invert(base) @ self.cell.turntable.camera_from_base
        lean = Rotation.from_matrix(error[:3, :3]).as_rotvec()
        shift = transforms.apply(error, middle[None])[0] - middle
        known = {
            'axis x': shift[0],
            'axis y': shift[1],
            'axis tilt x': lean[0],
            'axis tilt y': lean[1],
            'backlash': BACKLASH,
            f'angle cos {errors.order}': ANGLE * np.cos(errors.phase),
            f'angle sin {errors.order}': -ANGLE * np.sin(errors.phase),
        }
        here = transforms.apply(base, middle[None])[0]
        for laser, true in zip(believed.lasers, self.cell.lasers, strict=True):
            center = here - laser.normal * (laser.normal @ here + laser.offset)
            upright = base[:3, 2] - laser.normal * (laser.normal @ base[:3, 2])
            upright = upright / np.linalg.norm(upright)
            turn = np.cross(laser.normal, true.normal)
            known[f'{laser.name} yaw'] = turn @ upright
            known[f'{laser.name} roll'] = turn @ np.cross(laser.normal, upright)
            known[f'{laser.name} offset'] = true.normal @ center + true.offset
        return known

    def rms(self, views: Sequence[View], poses: Poses | None = None) -> float:
        return best_fit_rms(cloud(views, poses), self.nominal)


def cloud(views: Sequence[View], poses: Poses | None = None) -> Floats:
    poses = poses or Poses.identity(len(views))
    posed = zip(views, poses.turntable_from_view, strict=True)
    return np.concatenate([transforms.apply(T, view.cloud()) for view, T in posed])


def best_fit_rms(points_xyz: Floats, nominal: Surface) -> float:
    """Return the rms distance of points from a surface to which they were fitted, meters."""
    points = points_xyz[::_STRIDE]
    T = np.eye(4)
    for _ in range(5):
        here = transforms.apply(T, points)
        near = nominal.nearest(here)
        off = ((here - near.points_xyz) * near.normals).sum(axis=1)
        J = np.hstack([np.cross(here, near.normals), near.normals])
        fits = np.abs(off) < 5.0 * np.median(np.abs(off))
        # a ridge, because a round part may turn freely
        normal = J[fits].T @ J[fits] + 1e-9 * len(J) * np.eye(6) * 1e-3
        step = np.linalg.solve(normal, -J[fits].T @ off[fits])
        T = transforms.rigid(Rotation.from_rotvec(step[:3]).as_matrix(), step[3:]) @ T
    distance = nominal.nearest(transforms.apply(T, points)).distance
    return float(np.sqrt(np.mean(distance**2)))


def share_left(uncorrected: float, corrected: float, perfect: float) -> float:
    """Return sqrt(C^2 - P^2) / sqrt(U^2 - P^2)."""
    left = max(corrected**2 - perfect**2, 0.0)
    return float(np.sqrt(left / max(uncorrected**2 - perfect**2, 1e-30)))
