# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Pose of one surface on another without an initial pose: the one that fits, or an error.

Candidates of a global search are aligned by coarse ICP, and the best by point-to-plane
registration. Agreeing and contradicting surfels decide between them. A symmetric part looks the
same in several poses, which no registration can tell apart: the error names the motions between
them, and none is chosen.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import AmbiguousError
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import Floats
from ivfmc_ros.registration.merge.bodies import ClampedSurface
from ivfmc_ros.registration.merge.coarse_icp import refine_candidates
from ivfmc_ros.registration.merge.free_motion import constraining_poses
from ivfmc_ros.registration.merge.free_motion import pose_uncertainty
from ivfmc_ros.registration.merge.free_motion import PoseUncertainty
from ivfmc_ros.registration.merge.free_motion import sample_motion
from ivfmc_ros.registration.merge.hole_alignment import align_holes
from ivfmc_ros.registration.merge.hole_alignment import constraining_holes
from ivfmc_ros.registration.merge.hole_alignment import HoleFit
from ivfmc_ros.registration.merge.hole_alignment import matching_poses
from ivfmc_ros.registration.merge.hole_alignment import motion_transform
from ivfmc_ros.registration.merge.motion_text import describe_free_motion
from ivfmc_ros.registration.merge.motion_text import describe_motion
from ivfmc_ros.registration.merge.point_pair_features import box_corners
from ivfmc_ros.registration.merge.point_pair_features import diameter
from ivfmc_ros.registration.merge.point_pair_features import search_poses
from ivfmc_ros.registration.merge.pose_evidence import Evidence
from ivfmc_ros.registration.merge.pose_evidence import SurfaceIndex
from ivfmc_ros.registration.solver.gauss_newton import find_overlaps
from ivfmc_ros.registration.solver.gauss_newton import RegistrationProblem
from ivfmc_ros.registration.solver.gauss_newton import solve_registration
from ivfmc_ros.registration.solver.normal_equations import DOF

# The constants of the verdicts are checked by the rows 'merge' of bench_registration: of 20 random
# clampings of the demo part, each must be right within 0.1 mm or refused.

# Candidates that are refined at most, and the least fraction of the best overlap of a rival pose.
_MAX_REFINED, _RIVAL_OVERLAP = 12, 0.7
# Surfels of each surface in the coarse refinement, which many candidates go through.
_COARSE_SURFELS = 6000
# A pose with a smaller agreeing fraction of the surfels is not accepted.
_MIN_AGREE = 0.1
# Nor is one with more contradicting surfels than this fraction of the agreeing ones.
_MAX_AGAINST = 0.1
# Weight of contradicting surfels against agreeing ones in the order of poses.
_AGAINST_WEIGHT = 3.0
# A pose is refuted if it is contradicted by this many sigmas more than another one.
_REFUTED_SIGMAS = 4.0
# Surfaces agree within this many robust standard deviations of the residuals, or within this
# fraction of the surfel spacing: next to edges the quadric of a surfel errs by as much.
_SAME_SIGMAS, _SAME_SPACING = 6.0, 0.08
# Greatest distance of the axes of corresponding holes along a motion, in surfel spacings.
_MAX_HOLE_DISTANCE = 1.5
# meters, prior standard deviation of the poses in a refinement
_PRIOR_SIGMA = 1e-3
# Motions that an error message lists at most.
_MAX_LISTED = 6


@dataclass(frozen=True, eq=False, kw_only=True)
class PoseCandidate:
    """
    A refined pose of a source on a target.

    pose : (4, 4) target_from_source
    evidence : for and against it
    uncertainty : of the pose, by the common surface and holes
    scale : meters, robust standard deviation of the point-to-plane residuals
    """

    pose: Floats
    evidence: Evidence
    uncertainty: PoseUncertainty
    scale: float

    @property
    def score(self) -> float:
        """Agreeing fraction less the weighted contradicting fraction; orders the candidates."""
        return self.evidence.agree - _AGAINST_WEIGHT * self.evidence.against

    @property
    def is_constrained(self) -> bool:
        """Whether the common surface constrains all six motions."""
        return not len(self.uncertainty.unconstrained)


def find_pose(source: ClampedSurface, target: ClampedSurface, spacing: float) -> PoseCandidate:
    """
    Return the only pose of the source on the target at which the surfaces agree.

    spacing : of the surfels, meters
    :raises GeometryError: there is no such pose
    :raises AmbiguousError: there are several, or the common surface does not determine it
    """
    candidates = refine_candidates(source, target, search_poses(source, target))
    good = candidates.overlap > _RIVAL_OVERLAP * candidates.overlap.max(initial=0.0)
    poses = candidates.poses[good][:_MAX_REFINED]
    coarse = spacing * np.sqrt(max(1.0, max(len(source), len(target)) / _COARSE_SURFELS))
    rough = _PoseRefiner(source.downsampled(coarse), target.downsampled(coarse), coarse)
    first = rough.refine(poses, candidates.step / 2)
    _require_fit(source, target, first)
    best = first[0].evidence
    left = [one for one in first if one.evidence.worse_than(best) < 2.0 * _REFUTED_SIGMAS]
    fine = _PoseRefiner(source, target, spacing)
    last = fine.refine([one.pose for one in left], 2.0 * spacing)
    last = fine.distinct([*last, *fine.stopped_by_surface(last), *fine.aligned_by_holes(last)])
    _require_fit(source, target, last)
    accepted = [one for one in last if not _is_refuted(one, last)]
    return _require_unique(source, target, accepted, spacing)


class _PoseRefiner:
    """Refines poses of a source on a target and computes their evidence."""

    def __init__(self, source: ClampedSurface, target: ClampedSurface, spacing: float) -> None:
        self._source, self._target, self._spacing = source, target, spacing
        self._source_index = SurfaceIndex(source, spacing)
        self._target_index = SurfaceIndex(target, spacing)

    def refine(self, poses: Sequence[Floats], max_distance: float) -> list[PoseCandidate]:
        """
        Return distinct refined poses, the best first.

        max_distance : of correspondences at first, meters
        """
        return self.distinct([self._refine(T, max_distance) for T in poses])

    def stopped_by_surface(self, found: Sequence[PoseCandidate]) -> list[PoseCandidate]:
        """Return poses along the best one's unconstrained motion where surface opposes it."""
        poses = [
            T @ one.pose
            for one in _first_with_one_free_motion(found)
            for T in constraining_poses(
                self._source.transformed(one.pose),
                self._target,
                one.uncertainty.unconstrained[0],
                self._spacing,
            )
        ]
        return [self._refine(T, 2.0 * self._spacing) for T in poses]

    def aligned_by_holes(self, found: Sequence[PoseCandidate]) -> list[PoseCandidate]:
        """Return poses along the best one's unconstrained motion where round holes correspond."""
        free = _first_with_one_free_motion(found)
        return [aligned for one in free for aligned in self._align_all_holes(one)]

    def _align_all_holes(self, free: PoseCandidate) -> list[PoseCandidate]:
        motion = free.uncertainty.unconstrained[0]
        source = self._source.transformed(free.pose)
        holes = constraining_holes(source.holes, motion)
        others = constraining_holes(self._target.holes, motion)
        path = sample_motion(motion, source, self._spacing / 2)
        index = matching_poses(holes, others, path, _MAX_HOLE_DISTANCE * self._spacing)
        moved = [
            replace(free, pose=T, evidence=self._evidence(T, free.scale))
            for T in (path[k] @ free.pose for k in index)
        ]
        left = [one for one in moved if not _is_refuted(one, moved)]
        # a pose that is not refuted and that the holes do not constrain may be the true one
        if len(left) > _MAX_LISTED or any(self._hole_fit(one) is None for one in left):
            return []
        aligned = [self._align_holes(self._refine(one.pose, 2.0 * self._spacing)) for one in left]
        return [one for one in aligned if one is not None] if None not in aligned else []

    def _align_holes(self, one: PoseCandidate) -> PoseCandidate | None:
        """Move a pose along its unconstrained motion to align its holes; None if they do not."""
        if len(one.uncertainty.unconstrained) != 1:
            return one
        fit = self._hole_fit(one)
        if fit is None:
            return None
        pose = motion_transform(one.uncertainty.unconstrained[0], fit.amount) @ one.pose
        return replace(
            one,
            pose=pose,
            evidence=self._evidence(pose, one.scale),
            uncertainty=one.uncertainty.constrained(fit.sigma),
        )

    def _hole_fit(self, one: PoseCandidate) -> HoleFit | None:
        motion = one.uncertainty.unconstrained[0]
        holes = constraining_holes(self._source.transformed(one.pose).holes, motion)
        others = constraining_holes(self._target.holes, motion)
        return align_holes(holes, others, motion, _MAX_HOLE_DISTANCE * self._spacing)

    def _evidence(self, pose: Floats, scale: float) -> Evidence:
        noise = np.clip(_SAME_SIGMAS * scale, _SAME_SPACING * self._spacing, self._spacing)
        return self._source_index.evidence(self._target_index, pose, float(noise))

    def distinct(self, candidates: Sequence[PoseCandidate]) -> list[PoseCandidate]:
        """Return the best candidate of each group of nearly equal ones, the best first."""
        corners = box_corners(self._source.surfels.points_xyz)
        found: list[PoseCandidate] = []
        # of two equal poses, one of which is constrained, that one is kept
        for one in sorted(candidates, key=lambda each: (not each.is_constrained, -each.score)):
            here = transforms.apply(one.pose, corners)
            away = [np.abs(transforms.apply(other.pose, corners) - here).max() for other in found]
            if min(away, default=np.inf) > self._spacing:
                found.append(one)
        return sorted(found, key=lambda each: -each.score)

    def _refine(self, T: Floats, max_distance: float) -> PoseCandidate:
        source = self._source.transformed(T)
        surfels = [self._target.surfels, source.surfels]
        problem = RegistrationProblem(surfels=surfels, jacobian=None, spacing=self._spacing)
        result = solve_registration(
            problem, loose_prior_root([self._target, source]), max_distance
        )
        correspondences = find_overlaps(problem, result.poses, self._spacing)
        residuals = [np.abs(block.residuals) for block in correspondences]
        # 1.4826 times the median absolute deviation estimates the standard deviation
        scale = (
            1.4826 * float(np.median(np.concatenate(residuals))) if residuals else self._spacing
        )
        pose = result.poses[1] @ T
        return PoseCandidate(
            pose=pose,
            evidence=self._evidence(pose, scale),
            uncertainty=pose_uncertainty(result, 1, source.transformed(result.poses[1])),
            scale=scale,
        )


def _first_with_one_free_motion(found: Sequence[PoseCandidate]) -> list[PoseCandidate]:
    return [one for one in found if len(one.uncertainty.unconstrained) == 1][:1]


def loose_prior_root(surfaces: Sequence[ClampedSurface]) -> Floats:
    """Return the square root of the prior covariance: the first fixed, the others 1 mm."""
    sigma = np.zeros((len(surfaces), DOF))
    sigma[1:, :3] = 2.0 * _PRIOR_SIGMA / diameter(surfaces[0])
    sigma[1:, 3:] = _PRIOR_SIGMA
    return np.diag(sigma.ravel())


def _require_fit(
    source: ClampedSurface, target: ClampedSurface, ranked: Sequence[PoseCandidate]
) -> None:
    where = f'merge: no pose of {source.name} fits on {target.name}'
    if not ranked or ranked[0].evidence.agree < _MIN_AGREE:
        raise GeometryError(f'{where}: the scans have too little surface in common')
    best = ranked[0].evidence
    if best.against > _MAX_AGAINST * best.agree:
        raise GeometryError(
            f'{where}: in the best pose {best.agree:.0%} of the surface agree and '
            f'{best.against:.1%} contradict; check that both scans show the same part'
        )


def _is_refuted(one: PoseCandidate, others: Sequence[PoseCandidate]) -> bool:
    """Return whether another pose agrees about as much and is contradicted clearly less."""
    return any(
        one.evidence.worse_than(other.evidence) > _REFUTED_SIGMAS
        and other.evidence.agree > _RIVAL_OVERLAP * one.evidence.agree
        for other in others
    )


def _require_unique(
    source: ClampedSurface,
    target: ClampedSurface,
    accepted: Sequence[PoseCandidate],
    spacing: float,
) -> PoseCandidate:
    """
    Return the best constrained pose if no rival is left.

    :raises AmbiguousError: no pose is constrained, or there are several
    """
    constrained = [one for one in accepted if one.is_constrained]
    if not constrained:
        _refuse_unconstrained(source, target, accepted[0])
    best = constrained[0]
    rivals = [
        one
        for one in accepted
        if one is not best
        and one.evidence.agree > _RIVAL_OVERLAP * best.evidence.agree
        and not _leads_to(one, best, source, spacing)
    ]
    if rivals:
        _refuse_rivals(source, target, [best, *rivals])
    return best


def _leads_to(
    one: PoseCandidate, best: PoseCandidate, source: ClampedSurface, spacing: float
) -> bool:
    """
    Return whether a pose becomes the best one by its single unconstrained motion.

    Then it is no rival: at the best pose surfaces meet that have no counterpart elsewhere along
    the motion.
    """
    if len(one.uncertainty.unconstrained) != 1:
        return False
    corners = box_corners(source.surfels.points_xyz)
    there = transforms.apply(best.pose, corners)
    path = sample_motion(one.uncertainty.unconstrained[0], source.transformed(one.pose), spacing)
    return any(
        np.abs(transforms.apply(T @ one.pose, corners) - there).max() < 2.0 * spacing for T in path
    )


def _refuse_unconstrained(
    source: ClampedSurface, target: ClampedSurface, best: PoseCandidate
) -> None:
    free = [describe_free_motion(motion) for motion in best.uncertainty.unconstrained]
    raise AmbiguousError(
        f'merge: {source.name} on {target.name}: the common surface does not constrain '
        f'{" and ".join(free)}, in coordinates of {target.name}; add a scan that shows an edge, '
        'a hole or a flat that the other scan shows, too',
        motions=free,
    )


def _refuse_rivals(
    source: ClampedSurface, target: ClampedSurface, left: Sequence[PoseCandidate]
) -> None:
    best = transforms.invert(left[0].pose)
    motions = [describe_motion(one.pose @ best) for one in left[1:]]
    more = f' and {len(motions) - _MAX_LISTED} more' if len(motions) > _MAX_LISTED else ''
    raise AmbiguousError(
        f'merge: {source.name} fits on {target.name} in {len(left)} ways, which differ by '
        f'{"; ".join(motions[:_MAX_LISTED])}{more}, in coordinates of {target.name}; mark the '
        'part so that it has no symmetry, or scan a side that has none',
        motions=motions,
    )
