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

import numpy as np
from scipy.linalg import block_diag

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.registration.joint import Joint
from ivfmc_ros.registration.joint import meetings
from ivfmc_ros.registration.joint import reference_views
from ivfmc_ros.registration.joint import Scene
from ivfmc_ros.registration.joint import solve_jointly
from ivfmc_ros.registration.measured import as_measured
from ivfmc_ros.registration.measured import Measured
from ivfmc_ros.registration.measured import measured
from ivfmc_ros.registration.measured import refined_view
from ivfmc_ros.registration.measured import slopes
from ivfmc_ros.registration.patches import fit_patches
from ivfmc_ros.registration.prior import CellPrior
from ivfmc_ros.registration.prior import pose_root
from ivfmc_ros.registration.prior import TablePrior
from ivfmc_ros.registration.samples import common_edge
from ivfmc_ros.registration.samples import sample
from ivfmc_ros.registration.system import DOF
from ivfmc_ros.registration.system import Slopes
from ivfmc_ros.registration.table import significant
from ivfmc_ros.registration.unknowns import CellUnknowns
from ivfmc_ros.registration.unknowns import require_groups
from ivfmc_ros.registration.verdict import trimmed_rms

# A refined scan must fit by so much better than the calibrated one.
_GAIN = 0.995


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
    scan = _Scan(found=found, unknowns=unknowns, edge=common_edge(list(views)))
    if not np.isfinite(scan.edge):
        return scan.unchanged('not checked: no view has a surface')
    scene = scan.scene(views)
    still = np.tile(np.eye(4), (len(views), 1, 1))
    before = meetings(scene, still, reach)
    if not before:
        return scan.unchanged('not checked: no surface was seen twice')
    references, _ = reference_views(before, len(views))
    held = np.isin(np.arange(len(views)), references) | ('poses' not in chosen)
    root = block_diag(pose_root(table or TablePrior(), held), np.diag(unknowns.sigma))
    joint = solve_jointly(scene, root, reach)
    return scan.judged(joint, scene, reach)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Scan:
    found: Sequence[Measured]
    unknowns: CellUnknowns
    edge: float

    def scene(self, views: Sequence[View]) -> Scene:
        samples = [sample(view, self.edge) for view in views]
        patches = [fit_patches(thin, self.edge) for thin in samples]
        angles = [
            found.angles[thin.first[fitted.sample]]
            for found, thin, fitted in zip(self.found, samples, patches, strict=True)
        ]

        def slopes_at(view: int, points_xyz: Floats, near: Ints) -> Floats:
            cell = self.unknowns.cell
            there = as_measured(self.found[view], cell, points_xyz, angles[view][near])
            return slopes(there, self.unknowns)

        of_patches = [
            slopes_at(view, fitted.points_xyz, np.arange(len(fitted)))
            for view, fitted in enumerate(patches)
        ]
        known = Slopes(of_patches=of_patches, at=slopes_at)
        return Scene(patches=patches, slopes=known, edge=self.edge)

    def judged(self, joint: Joint, scene: Scene, reach: float) -> Refined:
        values = joint.cell_values
        views = [refined_view(found, self.unknowns, values) for found in self.found]
        still = np.tile(np.eye(4), (len(views), 1, 1))
        before = _misfit(scene, still, reach)
        after = _misfit(self.scene(views), joint.poses, reach)
        why = 'corrected'
        if not significant(joint.solution):
            why = 'calibration confirmed: nothing clearly contradicts it'
        elif not joint.converged:
            why = 'calibration believed: the refinement did not converge'
        elif after >= _GAIN * before:
            why = 'calibration believed: the correction fits no better'
        applied = why == 'corrected'
        return Refined(
            applied=applied,
            why=why,
            cell=self.unknowns.corrected(values) if applied else self.unknowns.cell,
            views=views if applied else [found.view for found in self.found],
            poses=Poses(turntable_from_view=joint.poses)
            if applied
            else Poses.identity(len(views)),
            estimates=self._estimates(joint),
            covariance=joint.solution.covariance[DOF * len(views) :, DOF * len(views) :],
            rms_before=before,
            rms_after=after if applied else before,
        )

    def _estimates(self, joint: Joint) -> list[Estimate]:
        first = DOF * len(self.found)
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
        sigma = self.unknowns.sigma
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
            covariance=np.diag(sigma**2),
            rms_before=float('nan'),
            rms_after=float('nan'),
        )


def _misfit(scene: Scene, poses: Floats, reach: float) -> float:
    left = [pairs.residuals for pairs in meetings(scene, poses, reach)]
    return trimmed_rms(np.concatenate(left)) if left else float('nan')


def _height(views: Sequence[View]) -> float:
    """Return the middle height of all points above the platter, metres."""
    heights = [np.nanmean(view.points_xyz[..., 2]) for view in views if view.valid.any()]
    return float(np.mean(heights)) if heights else 0.0
