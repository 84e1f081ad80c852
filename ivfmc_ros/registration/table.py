# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Joint registration of all views with the table's poses as prior, and its acceptance tests."""

from collections.abc import Collection
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace

import numpy as np

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.registration.solver.correspondences import Correspondences
from ivfmc_ros.registration.solver.degeneracy import Solution
from ivfmc_ros.registration.solver.downsample import common_voxel_size
from ivfmc_ros.registration.solver.downsample import downsample
from ivfmc_ros.registration.solver.downsample import MAX_SAMPLES
from ivfmc_ros.registration.solver.gauss_newton import find_overlaps
from ivfmc_ros.registration.solver.gauss_newton import pose_vector
from ivfmc_ros.registration.solver.gauss_newton import reference_views
from ivfmc_ros.registration.solver.gauss_newton import RegistrationProblem
from ivfmc_ros.registration.solver.gauss_newton import RegistrationResult
from ivfmc_ros.registration.solver.gauss_newton import solve_registration
from ivfmc_ros.registration.solver.prior import pose_prior_factor
from ivfmc_ros.registration.solver.prior import TablePrior
from ivfmc_ros.registration.solver.schedule import ConvergenceSchedule
from ivfmc_ros.registration.solver.schedule import QUICK
from ivfmc_ros.registration.solver.schedule import THOROUGH
from ivfmc_ros.registration.solver.surfels import fit_surfels
from ivfmc_ros.registration.solver.surfels import Surfels
from ivfmc_ros.registration.solver.verdict import fit_quality
from ivfmc_ros.registration.solver.verdict import FitQuality
from ivfmc_ros.registration.solver.verdict import least_observable_motion
from ivfmc_ros.registration.solver.verdict import MIN_OVERLAP
from ivfmc_ros.registration.solver.verdict import Verdict

# A correction of more prior standard deviations is an error of the registration.
_MAX_SIGMAS = 6.0
# A view with fewer surfels is not registered.
_MIN_SURFELS = 30
# A correction is significant if its chi-square exceeds the expectation under noise by so many of
# its standard deviations.
_SIGNIFICANCE = 4.0
# A rigid motion is rejected if the rms after it exceeds both this share of the rms before and so
# many times the points' noise: the views differ by an error of the cell or a deformed part.
_MAX_RMS_RATIO, _MAX_RMS_NOISE = 0.5, 2.0
# The rms may grow by this factor at most. It is not 1, because a part that constrains the motion
# in a few surfels only leaves the rms of all others to chance (bench rows 'rms over that of the
# table').
_MAX_RMS_GROWTH = 1.02
# How often the rejected views are fixed at the table's pose and the others solved again.
_ROUNDS = 3


def register_jointly(
    views: Sequence[View],
    prior: TablePrior,
    max_correspondence_distance: float,
    max_samples: int = MAX_SAMPLES,
) -> tuple[Poses, list[Verdict]]:
    """
    Register all views together; directions that the data do not constrain stay at the table.

    max_correspondence_distance : meters, by how much views may be apart at first
    max_samples : target number of samples of each view
    :raises GeometryError: a view has points farther than 100 m away, or partly finite points
    """
    surfels, spacing = fit_view_surfels(views, max_samples)
    problem = RegistrationProblem(surfels=surfels, jacobian=None, spacing=spacing)
    identity = np.tile(np.eye(4), (len(views), 1, 1))
    before = find_overlaps(problem, identity, max_correspondence_distance)
    references, components = reference_views(before, len(views))
    registration = _JointRegistration(
        numbers=[view.number for view in views],
        problem=problem,
        prior=prior,
        max_correspondence_distance=max_correspondence_distance,
        before=before,
        reference=np.isin(np.arange(len(views)), references),
        isolated=(np.bincount(components, minlength=len(views)) == 1)[components],
    )
    return registration.run()


def register_view(
    known: Surfels,
    view: Surfels,
    spacing: float,
    number: int,
    prior: TablePrior,
    max_correspondence_distance: float,
) -> tuple[Floats, Verdict]:
    """
    Register one view to a fixed surface, in a few iterations.

    view : its surfels at the expected pose
    spacing : meters, between surfels
    number : of the view, for the verdict
    max_correspondence_distance : meters
    returns : (4, 4) correction of the expected pose, and its verdict
    """
    # correspondences are searched from the view, which has fewer surfels than the known surface
    problem = RegistrationProblem(surfels=[view, known], jacobian=None, spacing=spacing)
    identity = np.tile(np.eye(4), (2, 1, 1))
    before = find_overlaps(problem, identity, max_correspondence_distance)
    isolated = not before
    registration = _JointRegistration(
        numbers=[number, -1],
        problem=problem,
        prior=prior,
        max_correspondence_distance=max_correspondence_distance,
        before=before,
        reference=np.array([isolated, True]),
        isolated=np.array([isolated, isolated]),
        schedule=QUICK,
    )
    poses, verdicts = registration.run()
    return poses.turntable_from_view[0], verdicts[0]


def fit_view_surfels(
    views: Sequence[View], max_samples: int = MAX_SAMPLES
) -> tuple[list[Surfels], float]:
    """Return the surfels of each view, and their common spacing in meters (NaN for none)."""
    spacing = common_voxel_size(list(views), max_samples)
    size = spacing if np.isfinite(spacing) else 1.0
    return [fit_surfels(downsample(view, size), size) for view in views], spacing


@dataclass(frozen=True, eq=False, kw_only=True)
class _JointRegistration:
    """
    Views at the table's poses, to be registered.

    before : correspondences at the table's poses, of all ordered pairs of views
    reference : (views,) bool, first view of each connected component of overlapping views
    isolated : (views,) bool, overlaps no other view
    """

    numbers: Sequence[int]
    problem: RegistrationProblem
    prior: TablePrior
    max_correspondence_distance: float
    before: list[Correspondences]
    reference: Bools
    isolated: Bools
    schedule: ConvergenceSchedule = THOROUGH

    def run(self) -> tuple[Poses, list[Verdict]]:
        """Solve, fix rejected views at the table's pose, and solve for the others again."""
        views = len(self.numbers)
        rejected: set[int] = set()
        verdicts = [self._unmoved(view) for view in range(views)]
        if self.reference.all():
            return Poses.identity(views), verdicts
        for _ in range(_ROUNDS):
            result = solve_registration(
                self.problem,
                self._prior_factor(rejected),
                self.max_correspondence_distance,
                schedule=self.schedule,
            )
            after = find_overlaps(self.problem, result.poses, self.max_correspondence_distance)
            solved = {
                view: self._verdict(view, result, after)
                for view in range(views)
                if not self.reference[view] and view not in rejected
            }
            new = {view for view, verdict in solved.items() if not verdict.applied}
            rejected |= new
            for view, verdict in solved.items():
                verdicts[view] = verdict
            if not new:
                return Poses(turntable_from_view=result.poses), verdicts
            if len(rejected) == len(verdicts) - self.reference.sum():
                return Poses.identity(views), verdicts
        return self._reject_all(verdicts)

    def _reject_all(self, verdicts: list[Verdict]) -> tuple[Poses, list[Verdict]]:
        why = 'table pose kept: neighboring views do not fit'
        rejected = [replace(v, applied=False, why=why) if v.applied else v for v in verdicts]
        return Poses.identity(len(verdicts)), rejected

    def _prior_factor(self, rejected: Collection[int]) -> Floats:
        fixed = self.reference.copy()
        fixed[list(rejected)] = True
        return pose_prior_factor(self.prior, fixed)

    def _unmoved(self, view: int) -> Verdict:
        surfels = len(self.problem.surfels[view])
        fit = fit_quality(view, self.before, surfels)
        why = 'reference'
        if surfels < _MIN_SURFELS:
            why = f'not checked: only {surfels} surfels'
        elif self.isolated[view] and len(self.numbers) > 1:
            why = 'not checked: overlaps with no other view'
        return Verdict(
            view=self.numbers[view],
            applied=False,
            why=why,
            overlap=fit.overlap,
            rms_before=fit.rms,
            rms_after=fit.rms,
        )

    def _verdict(
        self, view: int, result: RegistrationResult, after: Sequence[Correspondences]
    ) -> Verdict:
        surfels = len(self.problem.surfels[view])
        old = fit_quality(view, self.before, surfels)
        new = fit_quality(view, after, surfels)
        vector = pose_vector(result.poses[view])
        sigma = self.prior.sigma
        sigmas = float(np.max(np.abs(vector) / np.where(sigma > 0, sigma, np.inf)))
        weakest, free = least_observable_motion(result.equations, view, sigma)
        why = self._rejection(result, old, new, sigmas)
        return Verdict(
            view=self.numbers[view],
            applied=why == '',
            why=why or 'moved',
            overlap=new.overlap,
            rms_before=old.rms,
            rms_after=new.rms,
            rotation=float(np.linalg.norm(vector[:3])),
            translation=float(np.linalg.norm(vector[3:])),
            converged=result.converged,
            inliers=new.inliers,
            sigmas=sigmas,
            weakest=weakest,
            free=free,
            failed=self._has_failed(result, new, sigmas),
        )

    def _rejection(
        self, result: RegistrationResult, old: FitQuality, new: FitQuality, sigmas: float
    ) -> str:
        """Return why a correction is not applied; empty if it is."""
        tests = (
            (not self.prior.sigma.any(), 'the prior allows no correction'),
            (new.overlap < MIN_OVERLAP, f'only {new.overlap:.0%} overlap'),
            (not result.converged, 'the registration did not converge'),
            (sigmas > _MAX_SIGMAS, f"the correction is {sigmas:.0f} sigmas of the table's prior"),
            (not is_significant(result.solution), 'the views agree within their noise'),
            (new.rms > _MAX_RMS_GROWTH * old.rms, 'the correction makes the fit worse'),
            (
                new.rms > max(_MAX_RMS_RATIO * old.rms, _MAX_RMS_NOISE * new.noise),
                'a rigid motion explains too little of the difference between the views',
            ),
        )
        return next((f'table pose kept: {why}' for fails, why in tests if fails), '')

    def _has_failed(self, result: RegistrationResult, new: FitQuality, sigmas: float) -> bool:
        """Return whether a difference between the views remains that must not pass unnoticed."""
        if new.overlap < MIN_OVERLAP or not self.prior.sigma.any():
            return False
        return not result.converged or sigmas > _MAX_SIGMAS


def is_significant(solution: Solution) -> bool:
    """Return whether a correction is larger than noise explains (chi-square test)."""
    count = solution.directions.shape[1]
    limit = count + _SIGNIFICANCE * np.sqrt(2.0 * count)
    return bool(count > 0 and solution.chi_square > limit)
