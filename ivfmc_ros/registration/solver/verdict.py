# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Outcome of the registration of each view: overlap, fit, observability, and what was applied."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.registration.solver.correspondences import Correspondences
from ivfmc_ros.registration.solver.degeneracy import OBSERVABILITY_RATIO
from ivfmc_ros.registration.solver.normal_equations import DOF
from ivfmc_ros.registration.solver.normal_equations import NormalEquations

# A view that shares a smaller part of its surface with the others is not checked.
MIN_OVERLAP = 0.1
# Share of the distances that enters a trimmed rms: without the worst tenth.
_TRIM = 0.9
_MOTIONS = ('tilt about x', 'tilt about y', 'turn about z', 'shift in x', 'shift in y', 'lift')


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """
    Result of the registration of one view.

    view : number of the view
    applied : the pose was corrected; otherwise the table's pose is kept and ``why`` says why
    overlap : share of the view's points with a correspondence in another view
    rms_before, rms_after : meters, trimmed, of the distances along the surface's normal
    rotation, translation : radians and meters of the correction that was found
    inliers : share of the correspondences within three robust deviations
    sigmas : largest component of the correction, in prior standard deviations
    failed : the views differ, but no acceptable correction was found
    weakest : the motion that the shared surface constrains least
    free : how many of the six motions the data do not determine better than the prior
    """

    view: int
    applied: bool
    why: str
    overlap: float = 0.0
    rms_before: float = float('nan')
    rms_after: float = float('nan')
    rotation: float = 0.0
    translation: float = 0.0
    converged: bool = False
    inliers: float = float('nan')
    sigmas: float = 0.0
    weakest: str = ''
    free: int = 6
    failed: bool = False

    @property
    def checked(self) -> bool:
        """Whether the view shares enough surface with others for its pose to be checked."""
        return self.overlap >= MIN_OVERLAP


@dataclass(frozen=True, kw_only=True)
class FitQuality:
    """
    How well one view fits the others.

    overlap : share of its surfels with a correspondence
    rms : meters, along the normal, trimmed
    inliers : share of the correspondences within three robust deviations
    noise : meters, the rms that the points' own sigmas explain
    """

    overlap: float
    rms: float
    inliers: float
    noise: float


def fit_quality(view: int, blocks: Sequence[Correspondences], surfels: int) -> FitQuality:
    """
    Return the fit of a view from the correspondences in which it is ``a``.

    surfels : how many the view has
    """
    own = [block for block in blocks if block.a == view]
    if not own:
        return FitQuality(overlap=0.0, rms=float('nan'), inliers=float('nan'), noise=0.0)
    matched = np.zeros(surfels, dtype=bool)
    for block in own:
        matched[block.index_a] = True
    residuals = np.concatenate([block.residuals for block in own])
    deviation = 1.4826 * float(np.median(np.abs(residuals)))
    return FitQuality(
        overlap=float(matched.mean()),
        rms=trimmed_rms(residuals),
        inliers=float(np.mean(np.abs(residuals) <= 3.0 * deviation)),
        noise=float(np.median(np.concatenate([block.sigma for block in own]))),
    )


def trimmed_rms(distance: Floats) -> float:
    """Return the rms of (n,) distances without the worst tenth; NaN if there are none."""
    if not len(distance):
        return float('nan')
    best = np.sort(np.abs(distance))[: int(np.ceil(_TRIM * len(distance)))]
    return float(np.sqrt(np.mean(best**2)))


def least_observable_motion(
    equations: NormalEquations, view: int, sigma: Floats
) -> tuple[str, int]:
    """
    Return the motion of a view that the data constrain least, and how many are unobservable.

    The other views are held fixed.

    sigma : (6,) prior standard deviations, which make the motions comparable
    """
    own = slice(DOF * view, DOF * (view + 1))
    information = sigma[:, None] * equations.information[own, own] * sigma
    eigenvalues, motions = np.linalg.eigh(information)
    weakest = motions[:, 0]
    name = _MOTIONS[int(np.argmax(np.abs(weakest)))]
    return name, int((eigenvalues <= OBSERVABILITY_RATIO).sum())
