# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Distance between the surfaces that different lasers measured, after the registration."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.registration.solver.gauss_newton import find_overlaps
from ivfmc_ros.registration.solver.gauss_newton import RegistrationProblem
from ivfmc_ros.registration.solver.verdict import trimmed_rms
from ivfmc_ros.registration.table import fit_view_surfels

# If the rms exceeds the points' own noise by this factor, the laser planes or the axis are wrong.
_MAX_NOISE_RATIO = 4.0
# Samples of each view that are compared: enough for the rms, and fast.
_MAX_SAMPLES = 6000


@dataclass(frozen=True, kw_only=True)
class Misfit:
    """
    Distance between the surfaces of different lasers.

    rms : meters, along the normal, trimmed (without the worst tenth)
    noise : meters, the rms that the points' own sigmas explain
    correspondences : their number, between surfels of two lasers
    advice : what the operator can do; empty if the lasers fit
    """

    rms: float
    noise: float
    correspondences: int
    advice: str


def laser_misfit(
    views: Sequence[View], poses: Poses, max_correspondence_distance: float = 1.5e-3
) -> Misfit | None:
    """
    Compare the surfaces of different lasers; None if they share no surface.

    max_correspondence_distance : meters, along the normal
    """
    lasers = [view.laser for view in views]
    if len(set(lasers)) < 2:
        return None
    surfels, spacing = fit_view_surfels(views, _MAX_SAMPLES)
    problem = RegistrationProblem(surfels=surfels, jacobian=None, spacing=spacing)
    blocks = [
        block
        for block in find_overlaps(problem, poses.turntable_from_view, max_correspondence_distance)
        if lasers[block.a] != lasers[block.b]
    ]
    if not blocks:
        return None
    residuals = np.concatenate([block.residuals for block in blocks])
    rms = trimmed_rms(residuals)
    noise = float(np.median(np.concatenate([block.sigma for block in blocks])))
    advice = ''
    if rms > _MAX_NOISE_RATIO * noise:
        advice = (
            f'the lasers measure the same surface {rms * 1e3:.3f} mm apart, {rms / noise:.0f} '
            'times their noise: calibrate the laser planes and the axis again, or let this scan '
            'correct them (refine axis, angle, lasers)'
        )
    return Misfit(rms=rms, noise=noise, correspondences=len(residuals), advice=advice)
