# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Multi-view point-to-plane registration: Gauss-Newton over all view poses and the cell's parameters.

Correspondences between all overlapping views are minimized together, coarse to fine, on
point-to-plane distances (Chen and Medioni 1992) in their symmetric form (Rusinkiewicz 2019), with
robust weights (Geman and McClure 1987). There are six parameters a view, and those of the cell.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from itertools import permutations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.registration.solver.correspondences import Correspondences
from ivfmc_ros.registration.solver.correspondences import find_correspondences
from ivfmc_ros.registration.solver.correspondences import search_window
from ivfmc_ros.registration.solver.degeneracy import Solution
from ivfmc_ros.registration.solver.degeneracy import solve
from ivfmc_ros.registration.solver.normal_equations import build_normal_equations
from ivfmc_ros.registration.solver.normal_equations import CellJacobian
from ivfmc_ros.registration.solver.normal_equations import DOF
from ivfmc_ros.registration.solver.normal_equations import NormalEquations
from ivfmc_ros.registration.solver.normal_equations import ResidualNoise
from ivfmc_ros.registration.solver.normal_equations import robust_scale
from ivfmc_ros.registration.solver.schedule import coarse_distances
from ivfmc_ros.registration.solver.schedule import ConvergenceSchedule
from ivfmc_ros.registration.solver.schedule import THOROUGH
from ivfmc_ros.registration.solver.surfels import Surfels

# Two views with fewer correspondences do not overlap.
_MIN_CORRESPONDENCES = 30
# About so many surfels of a view are matched in the coarse phase.
_COARSE_SURFELS = 1500
# The robust kernel's width is the correspondence distance over this. A wide kernel keeps the few
# features that show the error from being taken for outliers.
_KERNEL_DIVISOR = 3.0
# The last correspondence distance, in robust deviations of the residuals.
_LAST_DISTANCE = 6.0
# Systematic error of whole regions, as a share of a surfel's sigma: a quadric only approximates
# the surface.
_CORRELATED_FRACTION = 0.3
# The coarse phase goes on to the next distance when a step is below this share of it.
_COARSE_TOLERANCE = 0.05
# Sigma of surfels where there are none, meters.
_DEFAULT_SIGMA = 1e-5


@dataclass(frozen=True, eq=False, kw_only=True)
class RegistrationProblem:
    """
    Input of the registration.

    surfels : of each view, frame ``turntable``
    jacobian : of the cell's parameters; None where the cell is fixed
    spacing : meters, between surfels
    origin : (C,) values of the cell's parameters for which the surfels were made; None for zeros
    correlated_fraction : systematic error of whole regions, as a share of a surfel's sigma
    """

    surfels: Sequence[Surfels]
    jacobian: CellJacobian | None
    spacing: float
    origin: Floats | None = None
    correlated_fraction: float = _CORRELATED_FRACTION

    def surfels_for(self, cell_values: Floats) -> Sequence[Surfels]:
        """Return the surfels for (C,) values of the cell's parameters, to first order."""
        change = cell_values if self.origin is None else cell_values - self.origin
        if self.jacobian is None or not change.any():
            return self.surfels
        return [
            surfels.displaced(np.einsum('ncd,c->nd', J, change))
            for surfels, J in zip(self.surfels, self.jacobian.at_surfels, strict=True)
        ]


@dataclass(frozen=True, eq=False, kw_only=True)
class RegistrationResult:
    """
    Result of the registration.

    poses : (views, 4, 4) turntable_from_view
    cell_values : (C,) values of the cell's parameters
    solution, equations : of the last step
    converged : the last step was below the noise of a surfel
    """

    poses: Floats
    cell_values: Floats
    solution: Solution
    equations: NormalEquations
    converged: bool


def solve_registration(
    problem: RegistrationProblem,
    prior_factor: Floats,
    max_correspondence_distance: float,
    start: RegistrationResult | None = None,
    schedule: ConvergenceSchedule = THOROUGH,
) -> RegistrationResult:
    """
    Find the poses of all views, and the cell's parameters as far as they are observable.

    prior_factor : (6 views + C, k), a matrix L with the prior's covariance L L'; rows of 0 fix a
        parameter
    max_correspondence_distance : meters, along the normal, of the first iterations
    start : continue from this result, with the fine phase only
    """
    views = len(problem.surfels)
    values = np.zeros(len(prior_factor)) if start is None else _values(start)
    pairs = list(combinations(range(views), 2))
    solver = _GaussNewton(
        problem=problem,
        prior_factor=prior_factor,
        size=_size(problem.surfels),
        schedule=schedule,
    )
    if start is None:
        for distance in coarse_distances(max_correspondence_distance, problem.spacing):
            values, pairs = solver.coarse(values, pairs, distance)
    return solver.fine(values, pairs, max_correspondence_distance)


@dataclass(frozen=True, eq=False, kw_only=True)
class _GaussNewton:
    """
    The iterations of one problem.

    size : meters, largest coordinate of all surfels; it turns rotations into displacements
    """

    problem: RegistrationProblem
    prior_factor: Floats
    size: float
    schedule: ConvergenceSchedule

    def coarse(
        self, values: Floats, pairs: list[tuple[int, int]], distance: float
    ) -> tuple[Floats, list[tuple[int, int]]]:
        """Iterate on a subset of the surfels; returns the values and the overlapping views."""
        for _ in range(self.schedule.coarse):
            blocks = self._blocks(values, pairs, distance, coarse=True)
            pairs = [(block.a, block.b) for block in blocks]
            _, solution = self._solve(blocks, values, distance, None)
            step = self._step_length(values, solution)
            values = _update(values, solution, self._views)
            if step < _COARSE_TOLERANCE * distance:
                break
        return values, pairs

    def fine(
        self, values: Floats, pairs: list[tuple[int, int]], max_distance: float
    ) -> RegistrationResult:
        """Iterate on all surfels, down to the distance that the residuals allow."""
        last = self._last_distance(values, pairs, max_distance)
        between = (
            coarse_distances(min(max_distance, self.problem.spacing), last)
            if self.schedule.middle
            else []
        )
        for distance in between:
            values, _, _, _ = self._iterate(values, pairs, distance, self.schedule.middle, None)
        values, equations, solution, step = self._iterate(
            values, pairs, last, self.schedule.fine, self.problem.spacing
        )
        return RegistrationResult(
            poses=_poses(values, self._views),
            cell_values=values[DOF * self._views :],
            solution=solution,
            equations=equations,
            converged=bool(step < 1.0),
        )

    def _iterate(
        self,
        values: Floats,
        pairs: list[tuple[int, int]],
        distance: float,
        iterations: int,
        spacing: float | None,
    ) -> tuple[Floats, NormalEquations, Solution, float]:
        """Iterate at one distance until convergence; the last value is the step, in sigmas."""
        fixed: Floats | None = None
        for iteration in range(iterations):
            blocks = self._blocks(values, pairs, distance, coarse=False)
            equations, solution = self._solve(blocks, values, distance, spacing, fixed)
            # a direction at the limit of observability would be solved in every other step
            fixed = solution.directions if iteration >= self.schedule.middle else None
            step = self._step_length(values, solution) / self._noise()
            values = _update(values, solution, self._views)
            if step < self.schedule.tolerance:
                break
        return values, equations, solution, step

    @property
    def _views(self) -> int:
        return len(self.problem.surfels)

    def _noise(self) -> float:
        """Return the median sigma of all surfels, meters."""
        sigma = [surfels.sigma for surfels in self.problem.surfels if len(surfels)]
        return float(np.median(np.concatenate(sigma))) if sigma else _DEFAULT_SIGMA

    def _last_distance(
        self, values: Floats, pairs: list[tuple[int, int]], max_distance: float
    ) -> float:
        """Return the last correspondence distance, meters, from the present residuals."""
        first = min(max_distance, self.problem.spacing)
        blocks = self._blocks(values, pairs, first, coarse=True)
        deviation = robust_scale(blocks) * self._noise() * np.sqrt(2.0)
        return float(np.clip(_LAST_DISTANCE * deviation, 0.1 * self.problem.spacing, max_distance))

    def _blocks(
        self, values: Floats, pairs: list[tuple[int, int]], distance: float, coarse: bool
    ) -> list[Correspondences]:
        """Return the correspondences of each pair of views that has enough of them."""
        surfels = self.problem.surfels_for(values[DOF * self._views :])
        poses = _poses(values, self._views)
        window = search_window(distance, self.problem.spacing)
        blocks = [
            find_correspondences(
                (a, b),
                (surfels[a], surfels[b]),
                (poses[a], poses[b]),
                window,
                max(1, len(surfels[a]) // _COARSE_SURFELS) if coarse else 1,
            )
            for a, b in pairs
        ]
        return [block for block in blocks if len(block) >= _MIN_CORRESPONDENCES]

    def _solve(
        self,
        blocks: list[Correspondences],
        values: Floats,
        distance: float,
        spacing: float | None,
        fixed: Floats | None = None,
    ) -> tuple[NormalEquations, Solution]:
        noise = ResidualNoise(
            scale=robust_scale(blocks),
            outlier_width=distance / _KERNEL_DIVISOR,
            correlated_fraction=self.problem.correlated_fraction,
        )
        equations = build_normal_equations(
            blocks, self.problem.jacobian, self._views, noise, spacing
        )
        return equations, solve(equations, values, self.prior_factor, fixed)

    def _step_length(self, values: Floats, solution: Solution) -> float:
        """Return an upper bound of the distance, meters, by which a step moves any point."""
        change = np.abs(solution.values - values)
        poses = change[: DOF * self._views].reshape(-1, DOF)
        of_poses = float((poses[:, :3].sum(axis=1) * self.size + poses[:, 3:].sum(axis=1)).max())
        cell = change[DOF * self._views :]
        if self.problem.jacobian is None or not len(cell):
            return of_poses
        jacobians = self.problem.jacobian.at_surfels
        largest = [np.abs(J).max(axis=(0, 2)) for J in jacobians if len(J)]
        return of_poses + float((np.max(largest, axis=0) * cell).sum()) if largest else of_poses


def reference_views(blocks: Sequence[Correspondences], views: int) -> tuple[Ints, Ints]:
    """
    Return the first view of each connected component of overlapping views.

    returns : (components,) view indices, (views,) component of each view
    """
    ends = np.array([(block.a, block.b) for block in blocks], dtype=np.int64).reshape(-1, 2)
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(views, views))
    _, component = connected_components(graph, directed=False)
    _, first = np.unique(component, return_index=True)
    return first.astype(np.int64), component.astype(np.int64)


def find_overlaps(
    problem: RegistrationProblem, poses: Floats, max_distance: float
) -> list[Correspondences]:
    """
    Return the correspondences of all ordered pairs of views that overlap.

    poses : (views, 4, 4) turntable_from_view
    max_distance : meters, along the normal
    """
    if not np.isfinite(problem.spacing):
        return []
    window = search_window(max_distance, problem.spacing)
    surfels = problem.surfels
    blocks = [
        find_correspondences((a, b), (surfels[a], surfels[b]), (poses[a], poses[b]), window)
        for a, b in permutations(range(len(surfels)), 2)
    ]
    return [block for block in blocks if len(block) >= _MIN_CORRESPONDENCES]


def pose_vector(T: Floats) -> Floats:
    """Return (6,) rotation vector (radians) and translation (meters) of a (4, 4) pose."""
    return np.concatenate([Rotation.from_matrix(T[:3, :3]).as_rotvec(), T[:3, 3]])


def _values(result: RegistrationResult) -> Floats:
    return np.concatenate([*map(pose_vector, result.poses), result.cell_values])


def _poses(values: Floats, views: int) -> Floats:
    vectors = values[: DOF * views].reshape(views, DOF)
    rotations = Rotation.from_rotvec(vectors[:, :3]).as_matrix()
    return np.array(
        [transforms.rigid(R, vector[3:]) for R, vector in zip(rotations, vectors, strict=True)]
    ).reshape(views, 4, 4)


def _update(values: Floats, solution: Solution, views: int) -> Floats:
    """Return the parameters after a step; pose increments are composed, not added."""
    updated = solution.values.copy()
    composed = _poses(solution.values - values, views) @ _poses(values, views)
    if views:
        poses = updated[: DOF * views].reshape(views, DOF)
        poses[:, :3] = Rotation.from_matrix(composed[:, :3, :3]).as_rotvec()
        poses[:, 3:] = composed[:, :3, 3]
    return updated


def _size(surfels: Sequence[Surfels]) -> float:
    """Return the largest coordinate of all surfels, meters."""
    return max((float(np.abs(s.points_xyz).max()) for s in surfels if len(s)), default=0.0)
