# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Two lasers, two objects? How far apart they see the same surface when all is registered."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.registration.solver.gauss_newton import meetings
from ivfmc_ros.registration.solver.gauss_newton import Scene
from ivfmc_ros.registration.solver.verdict import trimmed_rms
from ivfmc_ros.registration.table import surface_patches

# Beyond so many times the points' own noise the lasers' planes, or the axis, do not fit.
_LIMIT = 4.0
_MOST = 6000


@dataclass(frozen=True, kw_only=True)
class Misfit:
    """
    How far the surfaces of different lasers are apart.

    rms : metres, along the normal, without the worst tenth; noise : metres, what the points' own
        sigmas explain of it
    pieces : of surface that two lasers saw
    advice : what to do; empty if they fit
    """

    rms: float
    noise: float
    pieces: int
    advice: str


def laser_misfit(views: Sequence[View], poses: Poses, reach: float = 1.5e-3) -> Misfit | None:
    """Return how the lasers fit; None if no surface was seen by two of them."""
    lasers = [view.laser for view in views]
    if len(set(lasers)) < 2:
        return None
    patches, edge = surface_patches(views, _MOST)
    scene = Scene(patches=patches, slopes=None, edge=edge)
    pairs = [
        each
        for each in meetings(scene, poses.turntable_from_view, reach)
        if lasers[each.a] != lasers[each.b]
    ]
    if not pairs:
        return None
    left = np.concatenate([each.residuals for each in pairs])
    rms = trimmed_rms(left)
    noise = float(np.median(np.concatenate([each.sigma for each in pairs])))
    advice = ''
    if rms > _LIMIT * noise:
        advice = (
            f'the lasers see the same surface {rms * 1e3:.3f} mm apart, {rms / noise:.0f} times '
            'their noise: calibrate the laser planes and the axis again, or let this scan '
            'correct them (refine axis, angle, lasers)'
        )
    return Misfit(rms=rms, noise=noise, pieces=len(left), advice=advice)
