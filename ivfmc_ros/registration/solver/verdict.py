# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What became of each view in the registration, and how sure that is."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ivfmc_ros.model import Floats
from ivfmc_ros.registration.solver.correspondences import Pairs
from ivfmc_ros.registration.solver.degeneracy import CLEARLY
from ivfmc_ros.registration.solver.normal_equations import DOF
from ivfmc_ros.registration.solver.normal_equations import System

# A view that shares less than this with the others is not checked.
MIN_OVERLAP = 0.1
# Distances are compared without the worst tenth.
_TRIM = 0.9
_MOTIONS = ('tilt about x', 'tilt about y', 'turn about z', 'shift in x', 'shift in y', 'lift')


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """
    What became of one view.

    applied : the view was moved; otherwise it stays where the table put it, and why says so
    overlap : share of the view's points with a partner in another view
    inliers : share of the partners that fit
    rms_before, rms_after : metres, of the partners' distances along the surface's normal
    rotation, translation : radians and metres of what was found
    sigmas : the largest component of that, in sigmas of the table's prior
    weakest : the motion that the shared surface tells least about
    free : how many of six motions it does not tell better than the table
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

    @property
    def checked(self) -> bool:
        """Enough surface was shared with other views to tell where it belongs."""
        return self.overlap >= MIN_OVERLAP


@dataclass(frozen=True, kw_only=True)
class Fit:
    """
    How one view fits the others.

    overlap : share of its patches with a partner; rms : metres, along the normal, trimmed
    inliers : share of the pairs within three robust deviations
    noise : metres, what the points' own sigmas explain of rms
    """

    overlap: float
    rms: float
    inliers: float
    noise: float


def fit_of(view: int, blocks: Sequence[Pairs], patches: int) -> Fit:
    """Return how a view of so many patches fits, by the pairs in which it is ``a``."""
    own = [pairs for pairs in blocks if pairs.a == view]
    if not own:
        return Fit(overlap=0.0, rms=float('nan'), inliers=float('nan'), noise=0.0)
    touched = np.zeros(patches, dtype=bool)
    for pairs in own:
        touched[pairs.i] = True
    left = np.concatenate([pairs.residuals for pairs in own])
    usual = 1.4826 * float(np.median(np.abs(left)))
    return Fit(
        overlap=float(touched.mean()),
        rms=trimmed_rms(left),
        inliers=float(np.mean(np.abs(left) <= 3.0 * usual)),
        noise=float(np.median(np.concatenate([pairs.sigma for pairs in own]))),
    )


def trimmed_rms(distance: Floats) -> float:
    """Return the rms of distances without the worst tenth; NaN if there are none."""
    if not len(distance):
        return float('nan')
    best = np.sort(np.abs(distance))[: int(np.ceil(_TRIM * len(distance)))]
    return float(np.sqrt(np.mean(best**2)))


def weakest_motion(system: System, view: int, sigma: Floats) -> tuple[str, int]:
    """
    Return which motion of one view, the others held, the data tell least, and how many too little.

    sigma : (6,) the table's prior, which measures all motions alike
    """
    own = slice(DOF * view, DOF * (view + 1))
    information = sigma[:, None] * system.information[own, own] * sigma
    level, motions = np.linalg.eigh(information)
    weakest = motions[:, 0]
    name = _MOTIONS[int(np.argmax(np.abs(weakest)))]
    return name, int((level <= CLEARLY).sum())
