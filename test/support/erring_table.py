# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scans with known errors of table and cell, from exact stripe positions with pixel noise."""

from collections.abc import Callable
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import field
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Profile
from ivfmc_ros.model import View
from ivfmc_ros.registration.views.assemble import assemble
from ivfmc_ros.simulation.parts.loading import Solid
from ivfmc_ros.simulation.render.renderer import StripeRenderer
from ivfmc_ros.stripe.stripe import Stripe
from ivfmc_ros.stripe.triangulate import triangulate

# about what the maximum likelihood of the bench stripe reaches at speckle 0.15, pixels
NOISE = 0.08


@dataclass(frozen=True, eq=False, kw_only=True)
class Sweep:
    """
    A run of profiles of one laser.

    commanded, true : (n,) radians, reported and true table angle
    slip : (4, 4) of the part on the table since the first sweep
    """

    laser: int
    commanded: Floats
    true: Floats
    slip: Floats = field(default_factory=lambda: np.eye(4))


def turns(
    steps: int, error: Callable[[Floats], Floats], backlash: float = 0.0, lasers: int = 2
) -> list[Sweep]:
    """Return a turn for each laser, every other one backward; ``error`` of angles in radians."""
    angles = 2.0 * np.pi * np.arange(steps) / steps
    sweeps = []
    for laser in range(lasers):
        way = -1.0 if laser % 2 else 1.0
        true = angles + error(angles) + 0.5 * way * backlash
        order = slice(None, None, int(way))
        sweeps.append(Sweep(laser=laser, commanded=angles[order], true=true[order]))
    return sweeps


def stripes(
    cell: Cell, solid: Solid, sweeps: Sequence[Sweep], seed: int | None
) -> list[list[Stripe]]:
    """Return the stripe of each profile; without a seed there is no noise."""
    found = []
    for sweep in sweeps:
        standing = solid.moved(sweep.slip)
        renderer = StripeRenderer(cell=cell, solid=standing, platter=None)
        found.append([_stripe(renderer, angle, sweep.laser) for angle in sweep.true])
    if seed is None:
        return found
    rng = np.random.default_rng(seed)
    return [[noisy(stripe, rng) for stripe in lines] for lines in found]


def _stripe(renderer: StripeRenderer, angle: float, laser: int) -> Stripe:
    truth = renderer.truth(angle, laser)
    # one point per image line, as the extraction gives
    _, first = np.unique(truth.line, return_index=True)
    ones = np.ones(len(first))
    return Stripe(uv=truth.uv[first], intensity=100 * ones, width=2.5 * ones, sigma=NOISE * ones)


def noisy(stripe: Stripe, rng) -> Stripe:
    """Return a stripe with noise along u."""
    noise = NOISE * rng.standard_normal(len(stripe))
    return replace(stripe, uv=stripe.uv + np.outer(noise, (1.0, 0.0)))


def profiles_of(
    cell: Cell,
    measured: Sequence[Sequence[Stripe]],
    sweeps: Sequence[Sweep],
    *,
    true: bool = False,
) -> list[Profile]:
    """Triangulate with ``cell`` at commanded (or true) angles."""
    profiles: list[Profile] = []
    for number, (sweep, lines) in enumerate(zip(sweeps, measured, strict=True)):
        angles = sweep.true if true else sweep.commanded
        for angle, stripe in zip(angles, lines, strict=True):
            frame = Frame(
                image=np.zeros((1, 1), dtype=np.uint8),
                stamp_ns=len(profiles) * 50_000_000,
                angle=float(angle),
                laser=sweep.laser,
                view=number,
                seq=len(profiles),
            )
            profiles.append(triangulate(cell, frame, stripe))
    return profiles


def views_of(
    cell: Cell,
    measured: Sequence[Sequence[Stripe]],
    sweeps: Sequence[Sweep],
    *,
    true: bool = False,
) -> list[View]:
    """Return one view per sweep; with ``true``, of a part that never slipped."""
    views = assemble(cell, profiles_of(cell, measured, sweeps, true=true))
    if not true:
        return views
    back = [transforms.invert(sweep.slip) for sweep in sweeps]
    return [
        replace(view, points_xyz=transforms.apply(T, view.points_xyz))
        for view, T in zip(views, back, strict=True)
    ]


def erring_cell(
    cell: Cell, rng, *, offset: float = 1e-4, tilt: float = 0.05, laser_tilt: float = 0.05
) -> Cell:
    """Return the cell with errors of axis (meters, degrees) and of one laser plane."""
    across, way = rng.uniform(0, 2 * np.pi, 2)
    lean = np.radians(tilt) * np.array([np.cos(way), np.sin(way), 0.0])
    error = np.eye(4)
    error[:3, :3] = Rotation.from_rotvec(lean).as_matrix()
    middle = np.array([0.0, 0.0, 0.045])
    shift = offset * np.array([np.cos(across), np.sin(across), 0.0])
    error[:3, 3] = middle - error[:3, :3] @ middle + shift
    wrong = replace(cell.turntable, camera_from_base=cell.turntable.camera_from_base @ error)
    lasers = list(cell.lasers)
    chosen = int(rng.integers(len(lasers)))
    lasers[chosen] = tilted(cell, lasers[chosen], np.radians(laser_tilt), rng)
    return replace(cell, turntable=wrong, lasers=tuple(lasers))


def tilted(cell: Cell, laser, angle: float, rng):
    """Return a laser plane turned by ``angle`` radians about a point of the working volume."""
    point = cell.turntable.to_camera(
        np.append(rng.uniform(-0.03, 0.03, 2), rng.uniform(0.01, 0.08))[None], 0.0
    )[0]
    point -= laser.normal * (laser.normal @ point + laser.offset)
    about = np.cross(laser.normal, rng.standard_normal(3))
    about /= np.linalg.norm(about)
    normal = Rotation.from_rotvec(angle * about).apply(laser.normal)
    return replace(laser, normal=normal, offset=float(-normal @ point))
