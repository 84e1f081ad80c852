# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Self-calibration: correction of a cell's axis, table angle and laser planes from one scan.

Two lasers measure the same surface at two table angles; an error of the axis, angle or plane
separates the two measurements. Every point is a function of its pixel, table angle and cell, so
that point-to-plane distances between sweeps are minimized over the cell's parameters.
"""

from collections.abc import Collection
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.registration.self_calibration.calibration_prior import prior_covariance
from ivfmc_ros.registration.self_calibration.jacobians import cell_jacobian
from ivfmc_ros.registration.self_calibration.jacobians import corrected_view
from ivfmc_ros.registration.self_calibration.jacobians import measured_view
from ivfmc_ros.registration.self_calibration.jacobians import MeasuredView
from ivfmc_ros.registration.self_calibration.jacobians import measurements_at
from ivfmc_ros.registration.self_calibration.jacobians import noise_directions
from ivfmc_ros.registration.self_calibration.parameters import CellParameters
from ivfmc_ros.registration.self_calibration.parameters import require_groups
from ivfmc_ros.registration.self_calibration.passes import Pass
from ivfmc_ros.registration.self_calibration.passes import split_passes
from ivfmc_ros.registration.solver.correspondences import Correspondences
from ivfmc_ros.registration.solver.downsample import common_voxel_size
from ivfmc_ros.registration.solver.downsample import downsample
from ivfmc_ros.registration.solver.downsample import DownsampledView
from ivfmc_ros.registration.solver.gauss_newton import find_overlaps
from ivfmc_ros.registration.solver.gauss_newton import reference_views
from ivfmc_ros.registration.solver.gauss_newton import RegistrationProblem
from ivfmc_ros.registration.solver.gauss_newton import RegistrationResult
from ivfmc_ros.registration.solver.gauss_newton import solve_registration
from ivfmc_ros.registration.solver.normal_equations import CellJacobian
from ivfmc_ros.registration.solver.normal_equations import DOF
from ivfmc_ros.registration.solver.prior import CellPrior
from ivfmc_ros.registration.solver.prior import pose_prior_factor
from ivfmc_ros.registration.solver.prior import TablePrior
from ivfmc_ros.registration.solver.surfels import fit_surfels
from ivfmc_ros.registration.solver.surfels import Surfels
from ivfmc_ros.registration.solver.verdict import trimmed_rms
from ivfmc_ros.registration.table import is_significant
from ivfmc_ros.registration.views.assemble import viewing_vectors

# A correction is applied only if the rms falls below this share of what it was.
_MAX_RMS_RATIO = 0.95
# Systematic error of whole regions, as a share of a surfel's sigma: the error of a stripe depends
# on the angles at which laser and camera see the surface. Chosen by the bench rows 'worst error
# over claimed sigma'.
_CORRELATED_FRACTION = 0.6
# A stripe's noise moves points within the laser plane. On a surface along the plane at least this
# share of it is along the normal, because the points of a surfel are not collinear.
_MIN_NORMAL_SHARE = 0.15


@dataclass(frozen=True, kw_only=True)
class ParameterEstimate:
    """
    Estimate of one parameter of the cell, radians or meters.

    sigma : posterior standard deviation
    prior_sigma : prior standard deviation
    observed : the data determine it clearly better than the prior
    """

    name: str
    value: float
    sigma: float
    prior_sigma: float
    observed: bool


@dataclass(frozen=True, eq=False, kw_only=True)
class RefinementResult:
    """
    Result of the self-calibration.

    applied : the cell was corrected; otherwise ``why`` says why not, and cell and views are as
        given
    views, poses : for the corrected cell
    covariance : (C, C) of the estimates, in their order
    rms_before, rms_after : meters, trimmed, point-to-plane distance between sweeps
    height : meters above the platter of the point about which axis and planes rotate
    """

    applied: bool
    why: str
    cell: Cell
    views: list[View]
    poses: Poses
    estimates: list[ParameterEstimate]
    covariance: Floats
    rms_before: float
    rms_after: float
    height: float


def refine(
    cell: Cell,
    views: Sequence[View],
    groups: Collection[str],
    *,
    table: TablePrior | None = None,
    prior: CellPrior | None = None,
    max_correspondence_distance: float = 1.5e-3,
) -> RefinementResult:
    """
    Correct the cell by the scan, if the scan contradicts it significantly.

    groups : which parameters are estimated, of poses, axis, angle, lasers
    table, prior : standard deviations of the table's poses and of the cell
    max_correspondence_distance : meters
    :raises ParameterError: unknown group
    :raises GeometryError: the views were not made with ``cell``
    """
    chosen = require_groups(groups)
    parameters = CellParameters(
        cell=cell, groups=chosen, height=_height(views), prior=prior or CellPrior()
    )
    measured = [measured_view(cell, view) for view in views]
    scan = _Scan(
        measured=measured,
        passes=split_passes(cell, measured),
        parameters=parameters,
        spacing=common_voxel_size(list(views)),
        max_distance=max_correspondence_distance,
    )
    if not np.isfinite(scan.spacing):
        return scan.unchanged('not checked: no view has a surface')
    problem = scan.problem(np.zeros(len(parameters.names)))
    before = find_overlaps(problem, scan.table_poses, scan.max_distance)
    if not before:
        return scan.unchanged('not checked: no surface was measured twice')
    fixed = scan.references(before) | ('poses' not in chosen)
    factor = scan.prior_factor(table or TablePrior(), fixed)
    result = solve_registration(problem, factor, scan.max_distance)
    rms_before = _overlap_rms(problem, scan.table_poses, scan.max_distance)
    if is_significant(result.solution):
        # the surface changes with the cell: surfels are fitted again to the corrected points
        problem = scan.problem(result.cell_values)
        result = solve_registration(problem, factor, scan.max_distance, result)
    return scan.conclude(result, problem, rms_before)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Scan:
    """
    A scan whose passes are registered as views; the passes of one view share its pose.

    max_distance : meters, maximum correspondence distance
    """

    measured: Sequence[MeasuredView]
    passes: Sequence[Pass]
    parameters: CellParameters
    spacing: float
    max_distance: float

    @property
    def view_indices(self) -> Ints:
        """(passes,) index of the view of each."""
        return np.array([one.view_index for one in self.passes], dtype=np.int64)

    @property
    def table_poses(self) -> Floats:
        """(passes, 4, 4) poses by the table: identity."""
        return np.tile(np.eye(4), (len(self.passes), 1, 1))

    def references(self, blocks: Sequence[Correspondences]) -> Bools:
        """Return (views,) bool, first view of each connected component of overlapping views."""
        of_views = [
            replace(block, a=self.passes[block.a].view_index, b=self.passes[block.b].view_index)
            for block in blocks
        ]
        references, _ = reference_views(of_views, len(self.measured))
        return np.isin(np.arange(len(self.measured)), references)

    def prior_factor(self, table: TablePrior, fixed: Bools) -> Floats:
        """Return a factor L of the prior covariance L L' of the passes' poses and the cell."""
        rows = np.add.outer(DOF * self.view_indices, np.arange(DOF)).ravel()
        of_poses = pose_prior_factor(table, fixed)[rows]
        return np.asarray(block_diag(of_poses, np.diag(self.parameters.sigma)))

    def problem(self, values: Floats) -> RegistrationProblem:
        """Return the surfels of the passes for (C,) values of the cell, and their Jacobian."""
        parameters = replace(self.parameters, cell=self.parameters.corrected(values))
        views = [corrected_view(one, self.parameters, values) for one in self.measured]
        measured = [
            replace(one, view=view, angles=one.per_point(view.angles))
            for one, view in zip(self.measured, views, strict=True)
        ]
        samples = [
            self._downsample(one.extract(views[one.view_index]), parameters.cell)
            for one in self.passes
        ]
        surfels = [
            self._fit(
                sampled, noise_directions(measured[one.view_index], parameters.cell)[one.points]
            )
            for one, sampled in zip(self.passes, samples, strict=True)
        ]
        angles = [
            measured[one.view_index].angles[one.points][sampled.first[fitted.sample]]
            for one, sampled, fitted in zip(self.passes, samples, surfels, strict=True)
        ]

        def jacobian_at(number: int, points_xyz: Floats, near: Ints) -> Floats:
            view = measured[self.passes[number].view_index]
            there = measurements_at(view, parameters.cell, points_xyz, angles[number][near])
            return cell_jacobian(there, parameters)

        at_surfels = [
            jacobian_at(number, fitted.points_xyz, np.arange(len(fitted)))
            for number, fitted in enumerate(surfels)
        ]
        return RegistrationProblem(
            surfels=surfels,
            jacobian=CellJacobian(at_surfels=at_surfels, at=jacobian_at),
            spacing=self.spacing,
            origin=values,
            correlated_fraction=_CORRELATED_FRACTION,
        )

    def _downsample(self, view: View, cell: Cell) -> DownsampledView:
        samples = downsample(view, self.spacing)
        # the seen side follows from the camera: the grid's sense flips behind the axis
        return replace(samples, outward=samples.means(viewing_vectors(cell, view)))

    def _fit(self, samples: DownsampledView, directions: Floats) -> Surfels:
        """Fit surfels; sigma is the share of the noise, along (points, 3) directions, normal."""
        fitted = fit_surfels(samples, self.spacing)
        mean = samples.means(directions)[fitted.sample]
        share = np.abs((mean * fitted.normals).sum(axis=1))
        return replace(fitted, sigma=fitted.sigma * np.maximum(share, _MIN_NORMAL_SHARE))

    def conclude(
        self, result: RegistrationResult, problem: RegistrationProblem, rms_before: float
    ) -> RefinementResult:
        """Decide whether the correction is applied; rms_before : meters, without it."""
        values = result.cell_values
        views = [corrected_view(one, self.parameters, values) for one in self.measured]
        corrected = replace(problem, surfels=problem.surfels_for(values))
        rms_after = _overlap_rms(corrected, result.poses, self.max_distance)
        why = 'corrected'
        if not is_significant(result.solution):
            why = 'calibration confirmed: the scan does not contradict it significantly'
        elif not result.converged:
            why = 'calibration kept: the refinement did not converge'
        elif rms_after >= _MAX_RMS_RATIO * rms_before:
            why = 'calibration kept: the correction does not improve the fit'
        applied = why == 'corrected'
        _, first = np.unique(self.view_indices, return_index=True)
        cell = slice(DOF * len(self.passes), None)
        return RefinementResult(
            applied=applied,
            why=why,
            cell=self.parameters.corrected(values) if applied else self.parameters.cell,
            views=views if applied else [one.view for one in self.measured],
            poses=Poses(turntable_from_view=result.poses[first])
            if applied
            else Poses.identity(len(views)),
            estimates=self._estimates(result),
            covariance=result.solution.covariance[cell, cell],
            rms_before=rms_before,
            rms_after=rms_after if applied else rms_before,
            height=self.parameters.height,
        )

    def _estimates(self, result: RegistrationResult) -> list[ParameterEstimate]:
        first = DOF * len(self.passes)
        solution = result.solution
        columns = (
            self.parameters.names,
            result.cell_values.tolist(),
            solution.sigma[first:].tolist(),
            solution.prior_sigma[first:].tolist(),
            solution.observed[first:].tolist(),
        )
        return [
            ParameterEstimate(
                name=name, value=value, sigma=sigma, prior_sigma=prior_sigma, observed=observed
            )
            for name, value, sigma, prior_sigma, observed in zip(*columns, strict=True)
        ]

    def unchanged(self, why: str) -> RefinementResult:
        """Return the result of a scan that cannot be used: estimates are those of the prior."""
        covariance = prior_covariance(self.parameters)
        sigma = np.sqrt(np.diag(covariance))
        named = zip(self.parameters.names, sigma.tolist(), strict=True)
        return RefinementResult(
            applied=False,
            why=why,
            cell=self.parameters.cell,
            views=[one.view for one in self.measured],
            poses=Poses.identity(len(self.measured)),
            estimates=[
                ParameterEstimate(name=name, value=0.0, sigma=s, prior_sigma=s, observed=False)
                for name, s in named
            ],
            covariance=covariance,
            rms_before=float('nan'),
            rms_after=float('nan'),
            height=self.parameters.height,
        )


def _overlap_rms(problem: RegistrationProblem, poses: Floats, max_distance: float) -> float:
    """Return the trimmed rms, meters, of all overlaps; NaN if there are none."""
    residuals = [block.residuals for block in find_overlaps(problem, poses, max_distance)]
    return trimmed_rms(np.concatenate(residuals)) if residuals else float('nan')


def _height(views: Sequence[View]) -> float:
    """Return the mean height of all points above the platter, meters."""
    heights = [np.nanmean(view.points_xyz[..., 2]) for view in views if view.valid.any()]
    return float(np.mean(heights)) if heights else 0.0
