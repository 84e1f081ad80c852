# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Robust fit of a laser plane, with or without a bow, to stripe points of several views.

Least median of squares over pairs of views (Rousseeuw 1984) selects the views, total least
squares gives the initial plane. The final fit is a generalized least squares: each stripe is
weighted by the uncertainty of its pixels and of its board pose, and by one variance component for
errors common to a whole stripe (a board that flexes, blur), estimated by moments. The covariance
treats each view as one observation (Liang & Zeger 1986), with a small-sample correction.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace

import numpy as np

from ivfmc_ros.cell.laser import Bow
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats

# Random pairs of views: with half of the views wrong, a good pair is missed with 0.75^400.
_TRIALS = 400
_POINTS_PER_VIEW = 12  # of each view in a trial
_OUTLIER = 3.5  # robust sigmas, of a point
_OUTLIER_VIEW_FACTOR = 3.0  # medians over the views, of a view's median distance
_MAD_TO_SIGMA = 1.4826  # median absolute deviation to sigma of a normal distribution
_MAX_ITERATIONS = 8


@dataclass(frozen=True, eq=False, kw_only=True)
class StripePoints:
    """
    Triangulated stripe points of one view.

    points_xyz : (n, 3) meters, ``camera_optical_frame``
    pixel_jacobian : (n, 3) meters per pixel, derivative by the stripe position in the picture
    pose_jacobian : (n, 3, p) derivative by the p parameters of the pose of the board
    sigma : pixel, 1 sigma of a stripe position
    pose_covariance : (p, p) of the pose of the board
    """

    points_xyz: Floats
    pixel_jacobian: Floats
    pose_jacobian: Floats
    sigma: float
    pose_covariance: Floats

    def __len__(self) -> int:
        return len(self.points_xyz)

    def select(self, keep: Bools) -> 'StripePoints':
        """Return the points for which ``keep``, (n,) bool, is true."""
        return replace(
            self,
            points_xyz=self.points_xyz[keep],
            pixel_jacobian=self.pixel_jacobian[keep],
            pose_jacobian=self.pose_jacobian[keep],
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class PlaneFit:
    """
    A fitted plane n.X + d = 0 in ``camera_optical_frame``, with or without a bow.

    normal : (3,) unit vector; offset : d in meters
    covariance : (4, 4) of (nx, ny, nz, d), or (7, 7) with the coefficients of the bow
    """

    normal: Floats
    offset: float
    bow: Bow | None
    covariance: Floats

    def distance(self, points_xyz: Floats) -> Floats:
        """Return (n,) signed distances in meters."""
        distance = points_xyz @ self.normal + self.offset
        if self.bow is not None:
            distance = distance - bow_basis(self.bow, self.normal, points_xyz) @ (
                self.bow.coefficients
            )
        return np.asarray(distance)


def bow_basis(bow: Bow, normal: Floats, points_xyz: Floats) -> Floats:
    """Return (n, 3): s^2, s t, t^2 of each point in the axes of ``bow``, meters^2."""
    offset = points_xyz - bow.center
    s = offset @ bow.along
    t = offset @ np.cross(normal, bow.along)
    return np.stack([s * s, s * t, t * t], axis=1)


def least_median_plane(views: Sequence[StripePoints]) -> Floats:
    """
    Find the plane of least median distance over the views (LMedS, Rousseeuw 1984).

    returns : (4,) unit normal and offset
    """
    rng = np.random.default_rng(0)
    sampled = [
        view.points_xyz[np.linspace(0, len(view) - 1, _POINTS_PER_VIEW).astype(int)]
        for view in views
    ]
    samples = np.array(sampled)
    best, least = np.array([0.0, 0.0, 1.0, 0.0]), np.inf
    for _ in range(_TRIALS):
        i, j = rng.choice(len(views), 2, replace=False)
        plane = _plane_through(samples[i][0], samples[i][-1], samples[j][_POINTS_PER_VIEW // 2])
        if plane is None:
            continue
        off = np.median(np.abs(samples @ plane[:3] + plane[3]), axis=1)
        if np.median(off) < least:
            best, least = plane, float(np.median(off))
    return best


def _plane_through(a: Floats, b: Floats, c: Floats) -> Floats | None:
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal)
    if length < 1e-12:
        return None
    normal = normal / length
    return np.append(normal, -normal @ a)


def total_least_squares(points_xyz: Floats) -> Floats:
    """Return the (4,) plane of least squared distances; the normal points away from the camera."""
    center = points_xyz.mean(axis=0)
    normal = np.linalg.svd(points_xyz - center, full_matrices=False)[2][2]
    plane = np.append(normal, -normal @ center)
    return np.asarray(plane if plane[3] <= 0 else -plane)


def find_inliers(views: Sequence[StripePoints], plane: Floats) -> tuple[list[Bools], Floats]:
    """
    Select the points near the plane; a view whose median distance is an outlier has none.

    plane : (4,) initial unit normal and offset
    returns : (n,) bool of each view, and the (4,) plane refitted to the inliers
    """
    keep = [np.ones(len(view), dtype=bool) for view in views]
    for _ in range(_MAX_ITERATIONS):
        off = [np.abs(view.points_xyz @ plane[:3] + plane[3]) for view in views]
        typical = np.array([np.median(r) for r in off])
        good = typical <= _OUTLIER_VIEW_FACTOR * np.median(typical)
        pooled = np.concatenate([r for r, is_good in zip(off, good, strict=True) if is_good])
        limit = _OUTLIER * _MAD_TO_SIGMA * float(np.median(pooled))
        keep = [(r <= limit) & is_good for r, is_good in zip(off, good, strict=True)]
        points = [view.points_xyz[k] for view, k in zip(views, keep, strict=True)]
        plane = total_least_squares(np.concatenate(points))
    return keep, plane


def fit_plane(views: Sequence[StripePoints], plane: Floats, *, bowed: bool = False) -> PlaneFit:
    """
    Fit a plane, with a bow if ``bowed``, to stripes on boards of uncertain pose.

    plane : (4,) initial unit normal and offset
    """
    points = np.concatenate([view.points_xyz for view in views])
    center = points.mean(axis=0)
    axes = np.linalg.svd(points - center, full_matrices=False)[2]
    bow = Bow(center=center, along=axes[0], coefficients=np.zeros(3)) if bowed else None
    fit = PlaneFit(normal=plane[:3], offset=float(plane[3]), bow=bow, covariance=np.zeros((0, 0)))
    view_sigma = 0.0
    for _ in range(_MAX_ITERATIONS):
        fit = _gauss_newton(views, fit, view_sigma)
        view_sigma = _estimate_view_error(views, fit)
    return fit


def _gauss_newton(views: Sequence[StripePoints], fit: PlaneFit, view_sigma: float) -> PlaneFit:
    tangent = np.linalg.svd(fit.normal[None])[2][1:].T  # (3, 2)
    size = 3 if fit.bow is None else 6
    normal_matrix, scores = np.zeros((size, size)), []
    for view in views:
        design = _design(view, fit, tangent)
        weighted = _weighted_design(view, fit, view_sigma, design)
        normal_matrix = normal_matrix + design.T @ weighted
        scores.append(-weighted.T @ fit.distance(view.points_xyz))
    bread = np.asarray(np.linalg.inv(normal_matrix))
    step = bread @ np.sum(scores, axis=0)
    normal = fit.normal + tangent @ step[:2]
    length = np.linalg.norm(normal)
    moved = _updated_bow(fit.bow, step, normal / length, fit)
    return PlaneFit(
        normal=normal / length,
        offset=(fit.offset + step[2]) / length,
        bow=moved,
        covariance=_covariance(bread, np.array(scores), tangent),
    )


def _estimate_view_error(views: Sequence[StripePoints], fit: PlaneFit) -> float:
    """
    Estimate the error common to a whole stripe (offset, slope, curvature) by moments.

    It is what the uncertainty of pixels and board poses does not explain.

    returns : meters, 1 sigma of each of the three
    """
    excess = []
    for view in views:
        projector = np.linalg.pinv(error_shapes(view.points_xyz))
        pixel, pose = _distance_noise(view, fit.normal)
        expected = (projector**2) @ pixel + ((projector @ pose) ** 2).sum(axis=1)
        excess.append((projector @ fit.distance(view.points_xyz)) ** 2 - expected)
    return float(np.sqrt(max(np.mean(excess), 0.0)))


def error_shapes(points_xyz: Floats) -> Floats:
    """Return (n, 3): offset, slope and curvature along the stripe (Legendre polynomials)."""
    points = points_xyz - points_xyz.mean(axis=0)
    along = points @ np.linalg.svd(points, full_matrices=False)[2][0]
    along = along / max(np.abs(along).max(), 1e-12)
    return np.stack([np.ones_like(along), along, 1.5 * along**2 - 0.5], axis=1)


def _updated_bow(bow: Bow | None, step: Floats, normal: Floats, fit: PlaneFit) -> Bow | None:
    if bow is None:
        return None
    along = bow.along - (bow.along @ normal) * normal
    distance = bow.center @ normal + fit.offset + step[2]
    return Bow(
        center=bow.center - distance * normal,
        along=along / np.linalg.norm(along),
        coefficients=bow.coefficients + step[3:],
    )


def _design(view: StripePoints, fit: PlaneFit, tangent: Floats) -> Floats:
    """Return (n, 3 or 6): derivative of the distances by tilt, offset and bow."""
    columns = [view.points_xyz @ tangent, np.ones((len(view), 1))]
    if fit.bow is not None:
        columns.append(-bow_basis(fit.bow, fit.normal, view.points_xyz))
    return np.hstack(columns)


def _distance_noise(view: StripePoints, normal: Floats) -> tuple[Floats, Floats]:
    """Return (n,) variances of the distances by pixel noise and (n, p) deviations by the pose."""
    pixel = (view.sigma * (view.pixel_jacobian @ normal)) ** 2
    pose = np.einsum('nxp,x->np', view.pose_jacobian, normal)
    # square root by eigenvalues: the covariance of an exactly known pose has no Cholesky factor
    values, vectors = np.linalg.eigh(view.pose_covariance)
    return pixel, pose @ (vectors * np.sqrt(np.maximum(values, 0.0)))


def _weighted_design(
    view: StripePoints, fit: PlaneFit, view_sigma: float, design: Floats
) -> Floats:
    """Return C^-1 design, with C the covariance of the distances of a view (Woodbury)."""
    pixel, pose = _distance_noise(view, fit.normal)
    common = np.hstack([pose, view_sigma * error_shapes(view.points_xyz)])
    scaled = design / pixel[:, None]
    inner = np.eye(common.shape[1]) + common.T @ (common / pixel[:, None])
    correction = (common / pixel[:, None]) @ np.linalg.solve(inner, common.T @ scaled)
    return np.asarray(scaled - correction)


def _covariance(bread: Floats, scores: Floats, tangent: Floats) -> Floats:
    """
    Return the covariance of (nx, ny, nz, d, bow), one cluster per view.

    With few views the sandwich is too small: the model covariance is its lower bound.
    """
    views, parameters = len(scores), bread.shape[0]
    correction = views / max(views - parameters, 1)
    sandwich = bread @ (scores.T @ scores) @ bread * correction
    if np.trace(sandwich @ np.linalg.inv(bread)) < parameters:
        sandwich = bread
    expansion = np.zeros((parameters + 1, parameters))
    expansion[:3, :2] = tangent
    expansion[3:, 2:] = np.eye(parameters - 2)
    return np.asarray(expansion @ sandwich @ expansion.T)
