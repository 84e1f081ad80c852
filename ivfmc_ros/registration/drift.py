# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Drift of a laser: displacement of its light sheet between a part of a sweep and its repetition.

One laser measured the same surface at the same table angle twice, with the same errors of the
calibration. What differs is noise, a rotation that the table lost, and a light sheet or a camera
that moved in between, as a laser does while it warms up. Displacement of the sheet and rotation of
the table are fitted together to the point-to-plane distances (least squares, Huber weights), so
that a slip is not taken for a drift. A rotation of the camera across the stripe looks like a
displacement of the sheet.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace
import math

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.model import Floats
from ivfmc_ros.registration.agreement import max_difference
from ivfmc_ros.registration.agreement import stated_rms
from ivfmc_ros.registration.closure import repeated_sections
from ivfmc_ros.registration.sections import Section
from ivfmc_ros.registration.sections import Sections
from ivfmc_ros.registration.solver.correspondences import Correspondences
from ivfmc_ros.registration.solver.correspondences import find_correspondences
from ivfmc_ros.registration.solver.correspondences import search_window
from ivfmc_ros.registration.solver.correspondences import SearchWindow
from ivfmc_ros.registration.solver.surfels import concatenate_surfels
from ivfmc_ros.registration.solver.surfels import Surfels
from ivfmc_ros.registration.table_check import TableCheck

_COVERAGE = 2.0  # factor of the expanded uncertainty
# Significance in standard deviations; and the standard deviation that every displacement has at
# least, meters: errors of sampling that surfels at holes and edges share. Good scans of the demo
# part, three boxes and a cylinder, 90 to 200 profiles a turn: up to 0.05 mm on the demo
# part, with a sigma of 0.02, and up to 0.007 mm on the others.
_SIGMAS, _SAMPLING_STD = 4.0, 10e-6
# Greatest distance of two surfels along the normal, meters, as for closures.
_MAX_DISTANCE = 1.5e-3
# Least number of correspondences, and of their effective number (Kish 1965) for the displacement.
_MIN_CORRESPONDENCES, _MIN_EFFECTIVE = 60, 20.0
# Standard deviations of the rotation before the fit, radians: that of small slips, larger ones are
# found by the search over rotations (a round part shows none), and none at all. Surfels at holes
# and edges share an error that looks like a rotation of the table and a displacement of the sheet.
_ROTATION_STD, _NO_ROTATION = math.radians(1.0), math.radians(1e-4)
# The table did not slip if the fit finds a smaller rotation, radians, or one that is not
# significant, and if so many of the surfels then lie within this distance, meters, of the first
# ones (the least slip and the tolerance of the check for slips).
_MAX_ROTATION = math.radians(0.25)
_MIN_FITTING, _FITTING = 0.7, 1.2e-4
_RECTANGULAR = 1.0 / math.sqrt(3.0)  # standard deviation of a half-width (GUM 4.3.7)
_ITERATIONS, _CONVERGED = 8, 1e-8  # meters
# Huber's threshold, and the factor from the median absolute deviation to the standard deviation.
_HUBER, _MAD = 1.345, 1.4826
# Groups of neighboring surfels, by height, whose errors count as one for the uncertainty.
_GROUPS = 12
# Angles at which the plane of the laser is looked for at a surfel, and their range beyond the
# section that has it, radians.
_ANGLES, _MARGIN = 25, math.radians(1.0)


@dataclass(frozen=True, kw_only=True)
class Drift:
    """
    Displacement of the light sheet of a laser from the first to the second measurement.

    laser : index in the cell
    size, sigma : meters along the normal of the sheet, and 1 sigma
    rotation, rotation_sigma : radians by which the table lagged, found together with it
    fitting : share of the surfels measured again that then lie on the first ones
    """

    laser: int
    size: float
    sigma: float
    rotation: float
    rotation_sigma: float
    fitting: float

    @property
    def is_significant(self) -> bool:
        """Whether the sheet moved by more than noise explains."""
        return abs(self.size) > _SIGMAS * self.sigma

    @property
    def excludes_slip(self) -> bool:
        """Whether it explains the difference, and the table did not turn in between."""
        is_still = abs(self.rotation) < max(_MAX_ROTATION, _COVERAGE * self.rotation_sigma)
        return self.is_significant and is_still and self.fitting >= _MIN_FITTING

    @property
    def expanded_u(self) -> float:
        """Expanded uncertainty of the size, meters (k = 2)."""
        return _COVERAGE * self.sigma


def find_drifts(sections: Sections, cell: Cell) -> list[Drift]:
    """Return the drift of each laser that measured a part of the surface again at the end."""
    found = []
    for laser in sorted(set(sections.lasers)):
        views = [k for k, other in enumerate(sections.lasers) if other == laser]
        pairs = [
            pair
            for early in views
            for late in views
            for pair in repeated_sections(sections, early, late)
            # neighboring sweeps overlap too, but little time passes between
            if abs(pair[1].angle_from - pair[0].angle_from) > math.pi
        ]
        drift = _fit(pairs, laser, cell, sections.spacing) if pairs else None
        if drift is not None:
            found.append(drift)
    return found


def drift_text(drifts: Sequence[Drift], cell: Cell) -> str:
    """Return which lasers drifted, by how much, and what to do; '' for none."""
    parts = [
        f'{cell.lasers[one.laser].name} by {1e3 * one.size:+.3f} mm '
        f'(U = {1e3 * one.expanded_u:.3f} mm, k = 2)'
        for one in drifts
        if one.is_significant
    ]
    if not parts:
        return ''
    return (
        f'the light sheet moved from the beginning to the end of the scan: {", ".join(parts)}; '
        'the part is wrong by up to as much. Let lasers and camera warm up, check that both are '
        'fixed firmly, then scan again'
    )


def with_drifts(found: TableCheck, drifts: Sequence[Drift], cell: Cell) -> TableCheck:
    """
    Return the check of the table with what the drifts explain.

    A difference that a drift explains without a rotation is no slip, but NOT_CONVERGED, as is a
    drift beyond what views may differ by. Another one is said beside the code.
    """
    text = drift_text(drifts, cell)
    if not text:
        return found
    found = replace(found, drift=text)
    moved = [one for one in drifts if one.is_significant]
    is_named_slip = found.code == 'SLIPPED' and all(one.excludes_slip for one in moved)
    limit = max_difference(stated_rms(cell))
    is_large = max(abs(one.size) for one in moved) > limit
    if is_named_slip or (found.code in ('OK', 'UNCHECKED') and is_large):
        own = TableCheck(code='NOT_CONVERGED', detail=text, drift=text)
        return replace(own, compared=found.compared, round=found.round)
    return found


def _fit(
    pairs: list[tuple[Section, Section]], laser: int, cell: Cell, spacing: float
) -> Drift | None:
    firsts = {id(first): first for first, _ in pairs}.values()
    seconds = {id(second): second for _, second in pairs}.values()
    fixed = concatenate_surfels([item.surfels for item in firsts])
    moving = concatenate_surfels([item.surfels for item in seconds])
    if not len(fixed) or not len(moving):
        return None
    shifts = np.concatenate([_shifts(item, laser, cell) for item in seconds])
    window = search_window(_MAX_DISTANCE, spacing)
    turned = _fit_at(moving, fixed, shifts, window, _ROTATION_STD)
    unturned = _fit_at(moving, fixed, shifts, window, _NO_ROTATION)
    if turned is None or unturned is None:
        return None
    values, covariance = turned
    undone = _correspondences(moving, fixed, shifts, values, window)
    sigma, rotation_sigma = np.sqrt(np.diag(covariance)).tolist()
    # what depends on whether the table may have turned is not known better than that
    model = abs(float(values[0] - unturned[0][0])) * _RECTANGULAR
    return Drift(
        laser=laser,
        size=float(values[0]),
        sigma=math.hypot(sigma, model, _SAMPLING_STD),
        rotation=float(values[1]),
        rotation_sigma=rotation_sigma,
        fitting=float(np.mean(np.abs(undone.residuals) < _FITTING)) * len(undone) / len(moving),
    )


def _fit_at(
    moving: Surfels, fixed: Surfels, shifts: Floats, window: SearchWindow, rotation_std: float
) -> tuple[Floats, Floats] | None:
    """Return displacement and rotation, (2,), and their covariance; None if not determined."""
    values, covariance = np.zeros(2), np.full((2, 2), np.nan)
    for _ in range(_ITERATIONS):
        found = _correspondences(moving, fixed, shifts, values, window)
        if len(found) < _MIN_CORRESPONDENCES:
            return None
        solved = _solve(found, shifts, float(values[1]), rotation_std)
        if solved is None:
            return None
        change, covariance = solved
        values = values + change
        if abs(change[0]) < _CONVERGED:
            break
    return values, covariance


def _correspondences(
    moving: Surfels, fixed: Surfels, shifts: Floats, values: Floats, window: SearchWindow
) -> Correspondences:
    """Return the correspondences after the drift and the rotation found so far are undone."""
    undone = moving.displaced(values[0] * shifts)
    T = transforms.rigid(transforms.rotation_z(values[1]), (0.0, 0.0, 0.0))
    return find_correspondences((0, 1), (undone, fixed), (T, np.eye(4)), window)


def _shifts(section: Section, laser: int, cell: Cell) -> Floats:
    """
    Return (n, 3) what a displacement of the sheet by 1 adds to the true points of a section.

    A point lies where its ray meets the sheet. The table angle of a surfel is the one at which it
    lies in the sheet of the calibration.
    """
    points, sheet = section.surfels.points_xyz, cell.lasers[laser]
    angles = np.linspace(section.angle_from - _MARGIN, section.angle_to + _MARGIN, _ANGLES)
    in_camera = np.stack([cell.turntable.to_camera(points, angle) for angle in angles.tolist()])
    distance = np.abs(sheet.distance(in_camera.reshape(-1, 3)).reshape(len(angles), -1))
    nearest = distance.argmin(axis=0)
    seen = in_camera[nearest, np.arange(len(points))]
    along = seen / (seen @ sheet.normal)[:, None]
    base = along @ cell.turntable.camera_from_base[:3, :3]
    back = transforms.rotation_z(-angles[nearest])
    return np.asarray(np.einsum('nij,nj->ni', back, base))


def _solve(
    found: Correspondences, shifts: Floats, rotation: float, rotation_std: float
) -> tuple[Floats, Floats] | None:
    """
    Return the change of displacement and rotation, (2,), and their covariance, (2, 2).

    returns : None if the surface does not determine the displacement
    """
    normals, residuals = found.normals, found.residuals
    (x, y, _), (nx, ny, _) = found.midpoint.T, normals.T
    turned = shifts[found.index_a] @ transforms.rotation_z(rotation).T
    design = np.stack([(normals * turned).sum(axis=1), x * ny - y * nx], axis=1)
    if _effective(design) < _MIN_EFFECTIVE:
        return None
    spread = _MAD * float(np.median(np.abs(residuals - np.median(residuals))))
    deviation = np.maximum(found.sigma, spread)
    prior = np.diag([0.0, rotation_std**-2])
    change, bread, weight = np.zeros(2), np.eye(2), 1.0 / deviation**2
    for _ in range(_ITERATIONS):
        error = (residuals + design @ change) / deviation
        weight = np.minimum(1.0, _HUBER / np.maximum(np.abs(error), 1e-12)) / deviation**2
        bread = np.linalg.inv(design.T @ (weight[:, None] * design) + prior)
        change = bread @ (-design.T @ (weight * residuals) - prior @ np.array([0.0, rotation]))
    scores = design * (weight * (residuals + design @ change))[:, None]
    sandwich = bread @ _grouped(scores, found.midpoint[:, 2]) @ bread
    # few groups may agree by chance: the model is the lower limit
    return change, np.asarray(sandwich if sandwich[0, 0] > bread[0, 0] else bread)


def _effective(design: Floats) -> float:
    """Return the effective number of surfels that tell the displacement from a rotation."""
    shift, arm = design.T
    own = shift - arm * float(shift @ arm) / max(float(arm @ arm), 1e-30)
    return float((own**2).sum() ** 2 / max(float((own**4).sum()), 1e-60))


def _grouped(scores: Floats, heights: Floats) -> Floats:
    """Return the (2, 2) sum of squared scores of groups of neighbors (Liang and Zeger 1986)."""
    rank = np.argsort(np.argsort(heights))
    group = rank * _GROUPS // len(rank)
    sums = np.stack([np.bincount(group, column, _GROUPS) for column in scores.T], axis=1)
    return np.asarray(sums.T @ sums * _GROUPS / (_GROUPS - scores.shape[1]))
