# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A scan corrects the cell that took it.

Two lasers see the same piece of surface at two table angles; a wrong axis, angle or plane puts
it in two places. Every point is a function of its pixel, its angle and the cell, so that the
distances between such pieces are functions of the cell, and the cell is what makes them least.
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
from ivfmc_ros.registration.self_calibration.jacobians import as_measured
from ivfmc_ros.registration.self_calibration.jacobians import error_directions
from ivfmc_ros.registration.self_calibration.jacobians import Measured
from ivfmc_ros.registration.self_calibration.jacobians import measured
from ivfmc_ros.registration.self_calibration.jacobians import refined_view
from ivfmc_ros.registration.self_calibration.jacobians import slopes
from ivfmc_ros.registration.self_calibration.parameters import CellUnknowns
from ivfmc_ros.registration.self_calibration.parameters import require_groups
from ivfmc_ros.registration.self_calibration.passes import Pass
from ivfmc_ros.registration.self_calibration.passes import passes_of
from ivfmc_ros.registration.solver.correspondences import Pairs
from ivfmc_ros.registration.solver.downsample import common_edge
from ivfmc_ros.registration.solver.downsample import sample
from ivfmc_ros.registration.solver.downsample import Samples
from ivfmc_ros.registration.solver.gauss_newton import Joint
from ivfmc_ros.registration.solver.gauss_newton import meetings
from ivfmc_ros.registration.solver.gauss_newton import reference_views
from ivfmc_ros.registration.solver.gauss_newton import Scene
from ivfmc_ros.registration.solver.gauss_newton import solve_jointly
from ivfmc_ros.registration.solver.normal_equations import DOF
from ivfmc_ros.registration.solver.normal_equations import Slopes
from ivfmc_ros.registration.solver.prior import CellPrior
from ivfmc_ros.registration.solver.prior import pose_root
from ivfmc_ros.registration.solver.prior import TablePrior
from ivfmc_ros.registration.solver.surfels import fit_patches
from ivfmc_ros.registration.solver.surfels import Patches
from ivfmc_ros.registration.solver.verdict import trimmed_rms
from ivfmc_ros.registration.table import significant
from ivfmc_ros.registration.views.assemble import sight_of

# A refined scan must fit by so much better than the calibrated one.
_GAIN = 0.95
# Two lasers see a surface under different angles, and what a stripe is off by depends on these:
# whole regions are displaced by this share of a patch's sigma.
_LASTING = 0.6
# A stripe's noise moves points in the sheet; of a face that lies along it at least this share of
# it is across, because the pixels of a patch are no lines.
_LEAST_SHARE = 0.15


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """
    One unknown of the cell: radians or metres.

    sigma : 1 sigma of the value, with data and prior; observed : the data tell it clearly
        better than the prior
    """

    name: str
    value: float
    sigma: float
    prior_sigma: float
    observed: bool


@dataclass(frozen=True, eq=False, kw_only=True)
class Refined:
    """
    What a scan told of its cell.

    applied : the cell was changed; otherwise ``why`` says why not, and cell and views are as given
    views, poses : of the corrected cell
    covariance : (C, C) of the estimates, in their order
    rms_before, rms_after : metres, between pieces of surface that two sweeps saw, trimmed
    height : metres above the platter of the point about which axis and planes were turned
    """

    applied: bool
    why: str
    cell: Cell
    views: list[View]
    poses: Poses
    estimates: list[Estimate]
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
    reach: float = 1.5e-3,
) -> Refined:
    """
    Find what of the cell the scan contradicts, and correct it.

    groups : of poses, axis, angle, lasers: what may be wrong
    :raises ParameterError: a group is not known
    :raises GeometryError: the views were not made with ``cell``
    """
    chosen = require_groups(groups)
    unknowns = CellUnknowns(
        cell=cell, groups=chosen, height=_height(views), prior=prior or CellPrior()
    )
    found = [measured(cell, view) for view in views]
    scan = _Scan(
        found=found,
        passes=passes_of(cell, found),
        unknowns=unknowns,
        edge=common_edge(list(views)),
    )
    if not np.isfinite(scan.edge):
        return scan.unchanged('not checked: no view has a surface')
    scene = scan.scene(np.zeros(len(unknowns.names)))
    before = meetings(scene, scan.still, reach)
    if not before:
        return scan.unchanged('not checked: no surface was seen twice')
    held = scan.references(before) | ('poses' not in chosen)
    root = scan.root(table or TablePrior(), held)
    joint = solve_jointly(scene, root, reach)
    misfit = _misfit(scene, scan.still, reach)
    if significant(joint.solution):
        # surface that a wrong cell bent is another surface: patches are fitted anew
        scene = scan.scene(joint.cell_values)
        joint = solve_jointly(scene, root, reach, joint)
    return scan.judged(joint, scene, misfit, reach)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Scan:
    """The passes of a scan take the place of its views; those of one view have one pose."""

    found: Sequence[Measured]
    passes: Sequence[Pass]
    unknowns: CellUnknowns
    edge: float

    @property
    def owners(self) -> Ints:
        """(passes,) the view of each."""
        return np.array([one.owner for one in self.passes], dtype=np.int64)

    @property
    def still(self) -> Floats:
        """(passes, 4, 4), where the table put them."""
        return np.tile(np.eye(4), (len(self.passes), 1, 1))

    def references(self, blocks: Sequence[Pairs]) -> Bools:
        """Return (views,) which are the first of those that hang together."""
        of_views = [
            replace(block, a=self.passes[block.a].owner, b=self.passes[block.b].owner)
            for block in blocks
        ]
        references, _ = reference_views(of_views, len(self.found))
        return np.isin(np.arange(len(self.found)), references)

    def root(self, table: TablePrior, held: Bools) -> Floats:
        """Return a root of the prior of the passes' poses and the cell."""
        rows = np.add.outer(DOF * self.owners, np.arange(DOF)).ravel()
        return np.asarray(block_diag(pose_root(table, held)[rows], np.diag(self.unknowns.sigma)))

    def scene(self, values: Floats) -> Scene:
        """Return the surface of the passes as the cell with (C,) values sees it."""
        unknowns = replace(self.unknowns, cell=self.unknowns.corrected(values))
        views = [refined_view(one, self.unknowns, values) for one in self.found]
        found = [
            replace(one, view=view, angles=one.reported(view.angles))
            for one, view in zip(self.found, views, strict=True)
        ]
        samples = [self._sample(one.of(views[one.owner]), unknowns.cell) for one in self.passes]
        patches = [
            self._patches(thin, error_directions(found[one.owner], unknowns.cell)[one.points])
            for one, thin in zip(self.passes, samples, strict=True)
        ]
        angles = [
            found[one.owner].angles[one.points][thin.first[fitted.sample]]
            for one, thin, fitted in zip(self.passes, samples, patches, strict=True)
        ]

        def slopes_at(number: int, points_xyz: Floats, near: Ints) -> Floats:
            seen = found[self.passes[number].owner]
            there = as_measured(seen, unknowns.cell, points_xyz, angles[number][near])
            return slopes(there, unknowns)

        of_patches = [
            slopes_at(number, fitted.points_xyz, np.arange(len(fitted)))
            for number, fitted in enumerate(patches)
        ]
        known = Slopes(of_patches=of_patches, at=slopes_at)
        return Scene(
            patches=patches, slopes=known, edge=self.edge, origin=values, lasting=_LASTING
        )

    def _sample(self, view: View, cell: Cell) -> Samples:
        thin = sample(view, self.edge)
        # which side was seen is known by the camera: the grid's sense changes beyond the axis
        return replace(thin, outward=thin.means(sight_of(cell, view)))

    def _patches(self, thin: Samples, ways: Floats) -> Patches:
        """Fit patches; of the noise, along (points, 3) ways, counts what is along normals."""
        fitted = fit_patches(thin, self.edge)
        share = np.abs((thin.means(ways)[fitted.sample] * fitted.normals).sum(axis=1))
        return replace(fitted, sigma=fitted.sigma * np.maximum(share, _LEAST_SHARE))

    def judged(self, joint: Joint, scene: Scene, before: float, reach: float) -> Refined:
        """Decide whether a correction is used; ``before`` : the misfit without it, metres."""
        values = joint.cell_values
        views = [refined_view(found, self.unknowns, values) for found in self.found]
        after = _misfit(replace(scene, patches=scene.moved(values)), joint.poses, reach)
        why = 'corrected'
        if not significant(joint.solution):
            why = 'calibration confirmed: nothing clearly contradicts it'
        elif not joint.converged:
            why = 'calibration believed: the refinement did not converge'
        elif after >= _GAIN * before:
            why = 'calibration believed: the correction fits no better'
        applied = why == 'corrected'
        _, first = np.unique(self.owners, return_index=True)
        cell = slice(DOF * len(self.passes), None)
        return Refined(
            applied=applied,
            why=why,
            cell=self.unknowns.corrected(values) if applied else self.unknowns.cell,
            views=views if applied else [found.view for found in self.found],
            poses=Poses(turntable_from_view=joint.poses[first])
            if applied
            else Poses.identity(len(views)),
            estimates=self._estimates(joint),
            covariance=joint.solution.covariance[cell, cell],
            rms_before=before,
            rms_after=after if applied else before,
            height=self.unknowns.height,
        )

    def _estimates(self, joint: Joint) -> list[Estimate]:
        first = DOF * len(self.passes)
        solution = joint.solution
        columns = (
            self.unknowns.names,
            joint.cell_values.tolist(),
            solution.sigma[first:].tolist(),
            solution.prior_sigma[first:].tolist(),
            solution.observed[first:].tolist(),
        )
        return [
            Estimate(name=name, value=value, sigma=sigma, prior_sigma=before, observed=seen)
            for name, value, sigma, before, seen in zip(*columns, strict=True)
        ]

    def unchanged(self, why: str) -> Refined:
        covariance = prior_covariance(self.unknowns)
        sigma = np.sqrt(np.diag(covariance))
        named = zip(self.unknowns.names, sigma.tolist(), strict=True)
        return Refined(
            applied=False,
            why=why,
            cell=self.unknowns.cell,
            views=[found.view for found in self.found],
            poses=Poses.identity(len(self.found)),
            estimates=[
                Estimate(name=name, value=0.0, sigma=s, prior_sigma=s, observed=False)
                for name, s in named
            ],
            covariance=covariance,
            rms_before=float('nan'),
            rms_after=float('nan'),
            height=self.unknowns.height,
        )


def _misfit(scene: Scene, poses: Floats, reach: float) -> float:
    left = [pairs.residuals for pairs in meetings(scene, poses, reach)]
    return trimmed_rms(np.concatenate(left)) if left else float('nan')


def _height(views: Sequence[View]) -> float:
    """Return the middle height of all points above the platter, metres."""
    heights = [np.nanmean(view.points_xyz[..., 2]) for view in views if view.valid.any()]
    return float(np.mean(heights)) if heights else 0.0
