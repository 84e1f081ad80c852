# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A plane, or a slightly bowed sheet, through stripes on boards whose poses are uncertain.

Least median of squares over pairs of views (Rousseeuw 1984) finds the views that agree, total
least squares the first plane. The final fit weighs every stripe by what its pixels and the pose
of its board leave uncertain, and by how far whole stripes are off beyond that: a board that
flexes, blur (generalised least squares with one variance component, estimated by moments). The
covariance takes each view as one observation, with a small-sample correction.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace

import numpy as np

from ivfmc_ros.cell.laser import Bow
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats

_PAIRS = 400
_SAMPLE = 12
_OUTLIER = 3.5
_BAD_VIEW = 3.0
_MAD = 1.4826
_ROUNDS = 8


@dataclass(frozen=True, eq=False, kw_only=True)
class StripePoints:
    """
    The stripe of one view in space.

    points_xyz : (n, 3) metres, ``camera_optical_frame``
    by_pixel : (n, 3) metres per pixel: how a point moves when its stripe position does
    by_pose : (n, 3, p) how a point moves with the p parameters of its board's pose
    sigma : pixel, 1 sigma of a stripe position
    pose_covariance : (p, p)
    """

    points_xyz: Floats
    by_pixel: Floats
    by_pose: Floats
    sigma: float
    pose_covariance: Floats

    def __len__(self) -> int:
        return len(self.points_xyz)

    def chosen(self, keep: Bools) -> 'StripePoints':
        """Return it with only the chosen points, (n,) bool."""
        return replace(
            self,
            points_xyz=self.points_xyz[keep],
            by_pixel=self.by_pixel[keep],
            by_pose=self.by_pose[keep],
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Sheet:
    """
    A plane n.X + d = 0, perhaps with a bow.

    covariance : (4, 4) of (nx, ny, nz, d), or with the bow's coefficients (7, 7)
    """

    normal: Floats
    offset: float
    bow: Bow | None
    covariance: Floats

    def distance(self, points_xyz: Floats) -> Floats:
        """Return (n,) signed distances in metres."""
        distance = points_xyz @ self.normal + self.offset
        if self.bow is not None:
            distance = distance - bow_basis(self.bow, self.normal, points_xyz) @ (
                self.bow.coefficients
            )
        return np.asarray(distance)


def bow_basis(bow: Bow, normal: Floats, points_xyz: Floats) -> Floats:
    """Return (n, 3): s^2, s t, t^2 of each point in the plane's axes."""
    offset = points_xyz - bow.center
    s = offset @ bow.along
    t = offset @ np.cross(normal, bow.along)
    return np.stack([s * s, s * t, t * t], axis=1)


def agreeing_plane(views: Sequence[StripePoints]) -> Floats:
    """
    Find the plane that half of the views or more agree on.

    returns : (4,) unit normal and offset
    """
    rng = np.random.default_rng(0)
    few = [view.points_xyz[np.linspace(0, len(view) - 1, _SAMPLE).astype(int)] for view in views]
    samples = np.array(few)
    best, least = np.array([0.0, 0.0, 1.0, 0.0]), np.inf
    for _ in range(_PAIRS):
        i, j = rng.choice(len(views), 2, replace=False)
        plane = _through(samples[i][0], samples[i][-1], samples[j][_SAMPLE // 2])
        if plane is None:
            continue
        off = np.median(np.abs(samples @ plane[:3] + plane[3]), axis=1)
        if np.median(off) < least:
            best, least = plane, float(np.median(off))
    return best


def _through(a: Floats, b: Floats, c: Floats) -> Floats | None:
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal)
    if length < 1e-12:
        return None
    normal = normal / length
    return np.append(normal, -normal @ a)


def total_least_squares(points_xyz: Floats) -> Floats:
    """Return the (4,) plane of least squared distances, its normal away from the camera."""
    center = points_xyz.mean(axis=0)
    normal = np.linalg.svd(points_xyz - center, full_matrices=False)[2][2]
    plane = np.append(normal, -normal @ center)
    return np.asarray(plane if plane[3] <= 0 else -plane)


def inliers(views: Sequence[StripePoints], plane: Floats) -> tuple[list[Bools], Floats]:
    """
    Tell which points belong to the sheet; a view that is off as a whole has none.

    returns : (n,) bool of each view, and the plane refitted to them
    """
    keep = [np.ones(len(view), dtype=bool) for view in views]
    for _ in range(_ROUNDS):
        off = [np.abs(view.points_xyz @ plane[:3] + plane[3]) for view in views]
        typical = np.array([np.median(r) for r in off])
        good = typical <= _BAD_VIEW * np.median(typical)
        pooled = np.concatenate([r for r, is_good in zip(off, good, strict=True) if is_good])
        limit = _OUTLIER * _MAD * float(np.median(pooled))
        keep = [(r <= limit) & is_good for r, is_good in zip(off, good, strict=True)]
        points = [view.points_xyz[k] for view, k in zip(views, keep, strict=True)]
        plane = total_least_squares(np.concatenate(points))
    return keep, plane


def fit_sheet(views: Sequence[StripePoints], plane: Floats, *, bowed: bool = False) -> Sheet:
    """
    Fit a plane, or a bowed sheet, to stripes on uncertain boards.

    plane : (4,) near the answer
    """
    points = np.concatenate([view.points_xyz for view in views])
    center = points.mean(axis=0)
    axes = np.linalg.svd(points - center, full_matrices=False)[2]
    bow = Bow(center=center, along=axes[0], coefficients=np.zeros(3)) if bowed else None
    sheet = Sheet(normal=plane[:3], offset=float(plane[3]), bow=bow, covariance=np.zeros((0, 0)))
    flex = 0.0
    for _ in range(_ROUNDS):
        sheet = _gauss_newton(views, sheet, flex)
        flex = _flex(views, sheet)
    return sheet


def _gauss_newton(views: Sequence[StripePoints], sheet: Sheet, flex: float) -> Sheet:
    tangent = np.linalg.svd(sheet.normal[None])[2][1:].T  # (3, 2)
    size = 3 if sheet.bow is None else 6
    normal_matrix, scores = np.zeros((size, size)), []
    for view in views:
        design = _design(view, sheet, tangent)
        weighted = _weigh(view, sheet, flex, design)
        normal_matrix = normal_matrix + design.T @ weighted
        scores.append(-weighted.T @ sheet.distance(view.points_xyz))
    bread = np.asarray(np.linalg.inv(normal_matrix))
    step = bread @ np.sum(scores, axis=0)
    normal = sheet.normal + tangent @ step[:2]
    length = np.linalg.norm(normal)
    moved = _moved_bow(sheet.bow, step, normal / length, sheet)
    return Sheet(
        normal=normal / length,
        offset=(sheet.offset + step[2]) / length,
        bow=moved,
        covariance=_covariance(bread, np.array(scores), tangent),
    )


def _flex(views: Sequence[StripePoints], sheet: Sheet) -> float:
    """
    Estimate how far whole stripes are off (height, slope, curvature) beyond pixels and poses.

    returns : metres, 1 sigma of each of the three
    """
    excess = []
    for view in views:
        fit = np.linalg.pinv(_shapes(view))
        pixel, pose = _noise(view, sheet.normal)
        expected = (fit**2) @ pixel + ((fit @ pose) ** 2).sum(axis=1)
        excess.append((fit @ sheet.distance(view.points_xyz)) ** 2 - expected)
    return float(np.sqrt(max(np.mean(excess), 0.0)))


def _shapes(view: StripePoints) -> Floats:
    """Return (n, 3): height, slope and curvature along the stripe, orthogonal, of height 1."""
    points = view.points_xyz - view.points_xyz.mean(axis=0)
    along = points @ np.linalg.svd(points, full_matrices=False)[2][0]
    along = along / max(np.abs(along).max(), 1e-12)
    return np.stack([np.ones_like(along), along, 1.5 * along**2 - 0.5], axis=1)


def _moved_bow(bow: Bow | None, step: Floats, normal: Floats, sheet: Sheet) -> Bow | None:
    if bow is None:
        return None
    along = bow.along - (bow.along @ normal) * normal
    distance = bow.center @ normal + sheet.offset + step[2]
    return Bow(
        center=bow.center - distance * normal,
        along=along / np.linalg.norm(along),
        coefficients=bow.coefficients + step[3:],
    )


def _design(view: StripePoints, sheet: Sheet, tangent: Floats) -> Floats:
    """Return (n, 3 or 6): how the distances change with tilt, offset and bow."""
    columns = [view.points_xyz @ tangent, np.ones((len(view), 1))]
    if sheet.bow is not None:
        columns.append(-bow_basis(sheet.bow, sheet.normal, view.points_xyz))
    return np.hstack(columns)


def _noise(view: StripePoints, normal: Floats) -> tuple[Floats, Floats]:
    """Return the distances' (n,) variance by pixels and their (n, p) deviations by the pose."""
    pixel = (view.sigma * (view.by_pixel @ normal)) ** 2
    pose = np.einsum('nxp,x->np', view.by_pose, normal)
    # a root by eigenvalues: a pose that is known exactly has no Cholesky factor
    values, vectors = np.linalg.eigh(view.pose_covariance)
    return pixel, pose @ (vectors * np.sqrt(np.maximum(values, 0.0)))


def _weigh(view: StripePoints, sheet: Sheet, flex: float, design: Floats) -> Floats:
    """Return C^-1 design, C the covariance of the view's distances (Woodbury)."""
    pixel, pose = _noise(view, sheet.normal)
    common = np.hstack([pose, flex * _shapes(view)])
    scaled = design / pixel[:, None]
    inner = np.eye(common.shape[1]) + common.T @ (common / pixel[:, None])
    pulled = (common / pixel[:, None]) @ np.linalg.solve(inner, common.T @ scaled)
    return np.asarray(scaled - pulled)


def _covariance(bread: Floats, scores: Floats, tangent: Floats) -> Floats:
    """
    Return the covariance in (nx, ny, nz, d, bow), one cluster a view.

    Few views make the sandwich too small; the model's own covariance is its floor.
    """
    views, parameters = len(scores), bread.shape[0]
    correction = views / max(views - parameters, 1)
    sandwich = bread @ (scores.T @ scores) @ bread * correction
    if np.trace(sandwich @ np.linalg.inv(bread)) < parameters:
        sandwich = bread
    lift = np.zeros((parameters + 1, parameters))
    lift[:3, :2] = tangent
    lift[3:, 2:] = np.eye(parameters - 2)
    return np.asarray(lift @ sandwich @ lift.T)
