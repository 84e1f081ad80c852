# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Distance between the surfaces that different lasers measured, after the registration."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.registration.sampling import is_well_sampled
from ivfmc_ros.registration.solver.correspondences import Correspondences
from ivfmc_ros.registration.solver.gauss_newton import find_overlaps
from ivfmc_ros.registration.solver.gauss_newton import RegistrationProblem
from ivfmc_ros.registration.solver.verdict import trimmed_rms
from ivfmc_ros.registration.table import fit_view_surfels

# If the rms exceeds the points' own noise by this factor, the laser planes or the axis are wrong.
_MAX_NOISE_RATIO = 4.0
# Least correspondences between densely sampled surfels by which the lasers are judged.
_MIN_JUDGED = 30
# Samples of each view that are compared: enough for the rms, and fast.
_MAX_SAMPLES = 6000


@dataclass(frozen=True, kw_only=True)
class Misfit:
    """
    Distance between the surfaces of different lasers.

    rms : meters, along the normal, trimmed (without the worst tenth)
    noise : meters, the rms that the points' own sigmas explain
    correspondences : their number, between surfels of two lasers
    judged : number of those where both views have profiles close enough to tell an error of the
        calibration from that of the sampling (``sampling``)
    advice : what the operator can do; empty if the lasers fit
    """

    rms: float
    noise: float
    correspondences: int
    judged: int
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
    rms, noise, count = _statistics(blocks)
    dense = [
        is_well_sampled(view, own, max_correspondence_distance, _MAX_SAMPLES // len(views))
        for view, own in zip(views, surfels, strict=True)
    ]
    judged = _statistics(blocks, dense)
    return Misfit(
        rms=rms,
        noise=noise,
        correspondences=count,
        judged=judged[2],
        advice=_advice(*judged, all_rms=rms, all_noise=noise),
    )


def _statistics(
    blocks: Sequence[Correspondences], chosen: Sequence[Bools] | None = None
) -> tuple[float, float, int]:
    """
    Return trimmed rms and noise, meters, and number of correspondences.

    chosen : of each view, which surfels are used; None for all
    """
    residuals: list[Floats] = []
    sigmas: list[Floats] = []
    for block in blocks:
        used = np.ones(len(block), dtype=bool)
        if chosen is not None:
            used = chosen[block.a][block.index_a] & chosen[block.b][block.index_b]
        residuals.append(block.residuals[used])
        sigmas.append(block.sigma[used])
    count = sum(map(len, residuals))
    if not count:
        return 0.0, 0.0, 0
    noise = float(np.median(np.concatenate(sigmas)))
    return trimmed_rms(np.concatenate(residuals)), noise, count


def _advice(rms: float, noise: float, count: int, *, all_rms: float, all_noise: float) -> str:
    """Return what to do, by the densely sampled surfels and by all; '' if the lasers fit."""
    if count < _MIN_JUDGED:
        if all_rms <= _MAX_NOISE_RATIO * all_noise:
            return ''
        return (
            f'the lasers measure the same surface {all_rms * 1e3:.3f} mm apart; the profiles are '
            'too far apart to tell whether that is the calibration: take more profiles to check it'
        )
    if rms <= _MAX_NOISE_RATIO * noise:
        return ''
    return (
        f'the lasers measure the same surface {rms * 1e3:.3f} mm apart, {rms / noise:.0f} '
        'times their noise: check the steps per turn and calibrate the laser planes and the axis '
        'again, or let this scan correct them (refine axis, angle, lasers)'
    )
