# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""All views brought together, with the table as a prior: never worse than the table."""

from collections.abc import Collection
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace

import numpy as np

from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.registration.solver.correspondences import Pairs
from ivfmc_ros.registration.solver.degeneracy import Solution
from ivfmc_ros.registration.solver.downsample import common_edge
from ivfmc_ros.registration.solver.downsample import MOST_SAMPLES
from ivfmc_ros.registration.solver.downsample import sample
from ivfmc_ros.registration.solver.gauss_newton import Joint
from ivfmc_ros.registration.solver.gauss_newton import meetings
from ivfmc_ros.registration.solver.gauss_newton import pose_values
from ivfmc_ros.registration.solver.gauss_newton import reference_views
from ivfmc_ros.registration.solver.gauss_newton import Scene
from ivfmc_ros.registration.solver.gauss_newton import solve_jointly
from ivfmc_ros.registration.solver.prior import pose_root
from ivfmc_ros.registration.solver.prior import TablePrior
from ivfmc_ros.registration.solver.schedule import Pace
from ivfmc_ros.registration.solver.schedule import QUICK
from ivfmc_ros.registration.solver.schedule import THOROUGH
from ivfmc_ros.registration.solver.surfels import fit_patches
from ivfmc_ros.registration.solver.surfels import Patches
from ivfmc_ros.registration.solver.verdict import Fit
from ivfmc_ros.registration.solver.verdict import fit_of
from ivfmc_ros.registration.solver.verdict import MIN_OVERLAP
from ivfmc_ros.registration.solver.verdict import Verdict
from ivfmc_ros.registration.solver.verdict import weakest_motion

# A correction of more sigmas than this is a mistake of the registration, not of the table.
_IMPLAUSIBLE = 6.0
_LEAST_PATCHES = 30
# Corrections so little above what noise alone makes of them are noise (in its deviations).
_NOISE = 4.0
# A motion that leaves more than this share of the misfit, and more than so many sigmas of the
# points, is not what happened: the cell errs, or the part bends.
_LEFT, _NOISY = 0.5, 2.0
# A view whose partners are this much farther away fits worse. Not 1: what a blind part tells lies
# in a few patches, and the noise of all others moves the rms either way.
_WORSE = 1.02
# Views that were turned down are held at the table, and the others solved again.
_ROUNDS = 3


def joint_poses(
    views: Sequence[View], prior: TablePrior, reach: float, most: int = MOST_SAMPLES
) -> tuple[Poses, list[Verdict]]:
    """
    Find all poses at once; what the surface does not tell better than the table stays.

    reach : metres, by how much views may be apart at first
    most : about so many samples of each view are used
    :raises GeometryError: a view has points that no table carries
    """
    patches, edge = surface_patches(views, most)
    scene = Scene(patches=patches, slopes=None, edge=edge)
    before = meetings(scene, np.tile(np.eye(4), (len(views), 1, 1)), reach)
    references, sets = reference_views(before, len(views))
    table = _Table(
        numbers=[view.number for view in views],
        scene=scene,
        prior=prior,
        reach=reach,
        before=before,
        reference=np.isin(np.arange(len(views)), references),
        alone=(np.bincount(sets, minlength=len(views)) == 1)[sets],
    )
    return table.judged()


def place_on(
    known: Patches,
    view: Patches,
    edge: float,
    number: int,
    prior: TablePrior,
    reach: float,
) -> tuple[Floats, Verdict]:
    """
    Place one view on surface that stays where it is, in a few steps.

    view : its patches where it is expected; number : of the view, for the verdict
    edge : metres, between patches; reach : metres, by how much it may be off
    returns : the motion (4, 4) by which it was off, and its verdict
    """
    # the view is asked for partners, and not the surface: it has fewer patches
    scene = Scene(patches=[view, known], slopes=None, edge=edge)
    before = meetings(scene, np.tile(np.eye(4), (2, 1, 1)), reach)
    alone = not before
    table = _Table(
        numbers=[number, -1],
        scene=scene,
        prior=prior,
        reach=reach,
        before=before,
        reference=np.array([alone, True]),
        alone=np.array([alone, alone]),
        pace=QUICK,
    )
    poses, verdicts = table.judged()
    return poses.turntable_from_view[0], verdicts[0]


def surface_patches(
    views: Sequence[View], most: int = MOST_SAMPLES
) -> tuple[list[Patches], float]:
    """Return the patches of each view, and how far apart they are, metres (NaN for none)."""
    edge = common_edge(list(views), most)
    step = edge if np.isfinite(edge) else 1.0
    return [fit_patches(sample(view, step), step) for view in views], edge


@dataclass(frozen=True, eq=False, kw_only=True)
class _Table:
    """
    The views of a scan as the table put them.

    before : pairs of patches there, both ways
    reference : (views,) bool, the first view of each set that hangs together
    alone : (views,) bool, overlaps with no other
    """

    numbers: Sequence[int]
    scene: Scene
    prior: TablePrior
    reach: float
    before: list[Pairs]
    reference: Bools
    alone: Bools
    pace: Pace = THOROUGH

    def judged(self) -> tuple[Poses, list[Verdict]]:
        """Solve, turn down what must not be used, and solve the others again."""
        views = len(self.numbers)
        objections: dict[int, str] = {}
        found = [self._unmoved(view) for view in range(views)]
        if self.reference.all():
            return Poses.identity(views), found
        for _ in range(_ROUNDS):
            joint = solve_jointly(self.scene, self._root(objections), self.reach, pace=self.pace)
            after = meetings(self.scene, joint.poses, self.reach)
            moved = {
                view: self._verdict(view, joint, after)
                for view in range(views)
                if not self.reference[view] and view not in objections
            }
            new = {view: verdict for view, verdict in moved.items() if not verdict.applied}
            objections.update({view: verdict.why for view, verdict in new.items()})
            for view, verdict in moved.items():
                found[view] = verdict
            if not new:
                return Poses(turntable_from_view=joint.poses), found
            if len(objections) == len(found) - self.reference.sum():
                return Poses.identity(views), found
        return self._all_held(found)

    def _all_held(self, found: list[Verdict]) -> tuple[Poses, list[Verdict]]:
        why = 'table believed: views around it do not fit'
        held = [replace(v, applied=False, why=why) if v.applied else v for v in found]
        return Poses.identity(len(found)), held

    def _root(self, objections: Collection[int]) -> Floats:
        held = self.reference.copy()
        held[list(objections)] = True
        return pose_root(self.prior, held)

    def _unmoved(self, view: int) -> Verdict:
        patches = len(self.scene.patches[view])
        fit = fit_of(view, self.before, patches)
        why = 'reference'
        if patches < _LEAST_PATCHES:
            why = f'not checked: only {patches} pieces of surface'
        elif self.alone[view] and len(self.numbers) > 1:
            why = 'not checked: overlaps with no other view'
        return Verdict(
            view=self.numbers[view],
            applied=False,
            why=why,
            overlap=fit.overlap,
            rms_before=fit.rms,
            rms_after=fit.rms,
        )

    def _verdict(self, view: int, joint: Joint, after: Sequence[Pairs]) -> Verdict:
        patches = len(self.scene.patches[view])
        old, new = fit_of(view, self.before, patches), fit_of(view, after, patches)
        values = pose_values(joint.poses[view])
        sigma = self.prior.sigma
        sigmas = float(np.max(np.abs(values) / np.where(sigma > 0, sigma, np.inf)))
        weakest, free = weakest_motion(joint.system, view, sigma)
        why = self._objection(joint, old, new, sigmas)
        return Verdict(
            view=self.numbers[view],
            applied=why == '',
            why=why or 'moved',
            overlap=new.overlap,
            rms_before=old.rms,
            rms_after=new.rms,
            rotation=float(np.linalg.norm(values[:3])),
            translation=float(np.linalg.norm(values[3:])),
            converged=joint.converged,
            inliers=new.inliers,
            sigmas=sigmas,
            weakest=weakest,
            free=free,
        )

    def _objection(self, joint: Joint, old: Fit, new: Fit, sigmas: float) -> str:
        """Return why a correction must not be used; empty if it may."""
        objections = (
            (not self.prior.sigma.any(), 'the prior allows no correction'),
            (new.overlap < MIN_OVERLAP, f'only {new.overlap:.0%} overlap'),
            (not joint.converged, 'the registration did not converge'),
            (sigmas > _IMPLAUSIBLE, f'a correction of {sigmas:.0f} sigmas of the table'),
            (not significant(joint.solution), 'the views agree within their noise'),
            (new.rms > _WORSE * old.rms, 'the correction fits worse'),
            (
                new.rms > max(_LEFT * old.rms, _NOISY * new.noise),
                'a motion explains too little of how the views differ',
            ),
        )
        return next((f'table believed: {why}' for fails, why in objections if fails), '')


def significant(solution: Solution) -> bool:
    """Tell whether a correction is more than noise makes of nothing (chi-square of it)."""
    count = solution.directions.shape[1]
    return bool(count > 0 and solution.surprise > count + _NOISE * np.sqrt(2.0 * count))
