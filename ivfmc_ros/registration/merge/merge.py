# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Registration of several clampings of one part to each other, without an initial pose.

A clamping is one scan with registered views; it is one rigid body here. Each clamping is placed
by a global pose search on the union of those placed before it. In the end all poses are refined
together by multi-view point-to-plane registration.
"""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace

import numpy as np

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.registration.merge.bodies import ClampedSurface
from ivfmc_ros.registration.merge.bodies import Clamping
from ivfmc_ros.registration.merge.bodies import clamping_surfaces
from ivfmc_ros.registration.merge.bodies import union
from ivfmc_ros.registration.merge.free_motion import pose_uncertainty
from ivfmc_ros.registration.merge.pose_search import find_pose
from ivfmc_ros.registration.merge.pose_search import loose_prior_root
from ivfmc_ros.registration.merge.pose_search import PoseCandidate
from ivfmc_ros.registration.solver.gauss_newton import find_overlaps
from ivfmc_ros.registration.solver.gauss_newton import RegistrationProblem
from ivfmc_ros.registration.solver.gauss_newton import solve_registration
from ivfmc_ros.registration.solver.verdict import fit_quality

# The clamping number of a view is one byte in its message.
MAX_CLAMPINGS = 256
# Greatest correspondence distance of the last refinement, in surfel spacings. The pose search
# ends within about one spacing.
_MAX_CORRESPONDENCE_DISTANCE = 2.0


@dataclass(frozen=True, kw_only=True)
class Placing:
    """
    How the pose of one clamping was found.

    onto : names of the clampings that were placed before it
    agree, differ, blocked : fractions of the two surfaces, see ``Evidence``; those of the first
        clamping are 1, 0, 0
    sigma : meters, displacement of the part by the least certain motion of its pose, 1 sigma
    overlap : fraction of its surface that other clampings show, too
    rms : meters, trimmed rms distance along the normal in the overlap
    """

    name: str
    onto: tuple[str, ...] = ()
    agree: float = 1.0
    differ: float = 0.0
    blocked: float = 0.0
    sigma: float = 0.0
    overlap: float = 0.0
    rms: float = float('nan')


@dataclass(frozen=True, eq=False, kw_only=True)
class Merged:
    """
    Merged clampings, in the frame ``turntable`` of the first.

    first_from_clamping : (clampings, 4, 4) rigid
    placings : how each pose was found
    views, poses : of all clampings; views are numbered anew and carry their clamping's number
    """

    first_from_clamping: Floats
    placings: list[Placing]
    views: list[View]
    poses: Poses


def merge(clampings: Sequence[Clamping]) -> Merged:
    """
    Register the clampings of one part to each other.

    :raises ParameterError: fewer than two clampings, two of one name, or of different cells
    :raises GeometryError: the pose of a clamping is not found
    :raises AmbiguousError: several poses fit, or the common surface does not determine the pose
    """
    require_several([clamping.name for clamping in clampings])
    require_one_cell(clampings)
    surfaces, spacing = clamping_surfaces(clampings)
    placed = _place_all(surfaces, spacing)
    return _refine(clampings, surfaces, spacing, placed)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Placed:
    """A pose, and the names of the clampings it was searched on."""

    onto: tuple[str, ...]
    candidate: PoseCandidate


def _place_all(surfaces: Sequence[ClampedSurface], spacing: float) -> Mapping[int, _Placed]:
    """Return the pose of each surface but the first, by its index."""
    placed: dict[int, _Placed] = {}
    remaining = list(range(1, len(surfaces)))
    while remaining:
        poses = {0: np.eye(4), **{index: one.candidate.pose for index, one in placed.items()}}
        onto = union([surfaces[index].transformed(T) for index, T in poses.items()])
        index, candidate = _place_next(surfaces, remaining, onto, spacing)
        names = tuple(surfaces[k].name for k in poses)
        placed[index] = _Placed(onto=names, candidate=candidate)
        remaining.remove(index)
    return placed


def _place_next(
    surfaces: Sequence[ClampedSurface],
    remaining: Sequence[int],
    onto: ClampedSurface,
    spacing: float,
) -> tuple[int, PoseCandidate]:
    """Return the first of the remaining surfaces whose pose can be found, and that pose."""
    refusals: list[GeometryError] = []
    for index in remaining:
        try:
            return index, find_pose(surfaces[index], onto, spacing)
        except GeometryError as error:
            # a clamping placed later may add the surface that this one needs
            refusals.append(error)
    raise refusals[0]


def _refine(
    clampings: Sequence[Clamping],
    surfaces: Sequence[ClampedSurface],
    spacing: float,
    placed: Mapping[int, _Placed],
) -> Merged:
    """Refine all poses together."""
    initial = [
        placed[k].candidate.pose if k in placed else np.eye(4) for k in range(len(surfaces))
    ]
    moved = [surface.transformed(T) for surface, T in zip(surfaces, initial, strict=True)]
    problem = RegistrationProblem(
        surfels=[surface.surfels for surface in moved], jacobian=None, spacing=spacing
    )
    result = solve_registration(
        problem, loose_prior_root(moved), _MAX_CORRESPONDENCE_DISTANCE * spacing
    )
    refined = [P @ T for P, T in zip(result.poses, initial, strict=True)]
    correspondences = find_overlaps(problem, result.poses, spacing)
    placings = []
    for index, surface in enumerate(moved):
        fit = fit_quality(index, correspondences, len(surface))
        placing = Placing(name=surface.name, overlap=fit.overlap, rms=fit.rms)
        if index in placed:
            candidate = placed[index].candidate
            uncertainty = pose_uncertainty(result, index, surface)
            placing = replace(
                placing,
                onto=placed[index].onto,
                agree=candidate.evidence.agree,
                differ=candidate.evidence.differ,
                blocked=candidate.evidence.blocked,
                # the refinement does not use the holes, the search may have
                sigma=float(min(uncertainty.sigma.max(), candidate.uncertainty.sigma.max())),
            )
        placings.append(placing)
    turntable_from_view = [
        T @ clamping.poses.turntable_from_view
        for T, clamping in zip(refined, clampings, strict=True)
    ]
    return Merged(
        first_from_clamping=np.array(refined),
        placings=placings,
        views=_number_views(clampings),
        poses=Poses(turntable_from_view=np.concatenate(turntable_from_view)),
    )


def _number_views(clampings: Sequence[Clamping]) -> list[View]:
    views = [
        replace(view, clamping=index)
        for index, clamping in enumerate(clampings)
        for view in clamping.views
    ]
    return [replace(view, number=number) for number, view in enumerate(views)]


def require_several(names: Sequence[str]) -> None:
    """
    Check that there are two or more scans with different names.

    :raises ParameterError: there are not
    """
    if len(names) < 2:
        known = ', '.join(names) or 'none'
        raise ParameterError(f'merge: two or more scans are needed, not {known}')
    if len(names) > MAX_CLAMPINGS:
        raise ParameterError(f'merge: {len(names)} scans are too many; at most {MAX_CLAMPINGS}')
    if len(set(names)) < len(names):
        raise ParameterError(f'merge: a scan is named twice: {", ".join(names)}')


def require_one_cell(clampings: Sequence[Clamping]) -> None:
    """
    Check that all clampings were scanned with lasers and images of one cell.

    :raises ParameterError: names two clampings that were not
    """
    first, *others = clampings
    for other in others:
        if _optics(other) != _optics(first):
            raise ParameterError(
                f'merge: {first.name} and {other.name} were taken with different cells (lasers, '
                'or image size)'
            )


def _optics(clamping: Clamping) -> tuple[object, ...]:
    cell = clamping.cell
    return cell.camera.width, cell.camera.height, *(laser.name for laser in cell.lasers)
