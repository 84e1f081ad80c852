# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Robust joint adjustment of table axis, target layout and the table angle of every picture.

Parameters are the axis, the layout of the targets on the platter, the tilt of the platter against
the axis, the angle of every picture, and the scale where the nominal lengths of board or markers
are not used. The scale then comes from stripe points on the bare platter, triangulated by the
calibrated laser. The angles are eliminated (Schur complement); residuals are weighted by Huber's
function (Huber 1964).
"""

from dataclasses import dataclass
from dataclasses import replace
import math

import cv2
import numpy as np

from ivfmc_ros.calibration.turntable.axis import AxisState
from ivfmc_ros.calibration.turntable.axis import CornerObservations
from ivfmc_ros.calibration.turntable.axis import PlatterPoints
from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

_MAX_ITERATIONS = 60
_CONVERGED = 1e-9  # relative decrease of the cost at which the iteration stops
_STEP = 1e-6  # radians or meters, of the numerical Jacobians
# Huber's constant in sigmas: 95 % efficiency for normal noise
_HUBER = 1.345
# Prior standard deviation in meters of a marker corner's height above the platter: paper curls.
_CORNER_HEIGHT_STD = 3e-4
# Prior standard deviation in meters of the mean side of the markers, if that gives the scale.
_MEAN_SIDE_STD = 1e-5
# Order of the common parameters: rotation about x and y and translation of the base; tilt of the
# platter; scale; bloom; then three per group of the layout.
_BASE = 5
_TILT = slice(5, 7)
_SCALE = 7
_BLOOM = 8
_FIRST_GROUP = 9


@dataclass(frozen=True, kw_only=True)
class FreeAxisParameters:
    """
    Parameters that the adjustment estimates besides the angles.

    side : meters, nominal mean side of free markers; None if stripes give the scale
    scale : of a board's lengths
    layout : poses of the targets, or corners of the markers, on the platter
    base : pose of the axis
    tilt : of the platter against the axis
    """

    side: float | None = None
    scale: bool = False
    layout: bool = True
    base: bool = True
    tilt: bool = True


@dataclass(frozen=True, eq=False, kw_only=True)
class AxisAdjustment:
    """
    Result of the adjustment.

    covariance : (5, 5) of the base: rotation about its x and y in radians, translation in its
        axes in meters
    size_u : relative standard uncertainty of ``AxisState.size``; 0 if it was fixed
    angle_std : (pictures,) radians
    tilt_covariance : (2, 2) of ``AxisState.tilt``
    residuals : (n, 2) pixel, observed minus projected
    sigma : pixel, robust standard deviation of a coordinate
    """

    axis: AxisState
    covariance: Floats
    size_u: float
    angle_std: Floats
    tilt_covariance: Floats
    residuals: Floats
    sigma: float


def adjust_axis(
    start: AxisState,
    observations: CornerObservations,
    focal: Floats,
    free: FreeAxisParameters,
    platter_points: PlatterPoints,
    inflation: float = 1.0,
) -> AxisAdjustment:
    """
    Minimize the residuals of corners and platter points (Levenberg-Marquardt, Huber weights).

    focal : (2,) fx, fy in pixels
    platter_points : stripe points on the platter, may be empty
    inflation : factor on the sigma of the corners, from ``correlation_inflation``
    """
    size = _FIRST_GROUP + start.layout.size
    problem = _LeastSquaresProblem(
        observations, focal, platter_points, free.side, _free_columns(start, free), size, inflation
    )
    axis, equations, damping = start, problem.linearize(start), 1e-4
    for _ in range(_MAX_ITERATIONS):
        trial = apply_axis_step(axis, *problem.step(equations, damping))
        # weights and noise level of the last accepted state, so that the costs are comparable
        cost = problem.cost(trial, equations)
        gain = equations.cost - cost
        if not gain >= 0:
            damping *= 10
            if damping > 1e10:
                break
            continue
        axis, equations, damping = trial, problem.linearize(trial), max(damping / 10, 1e-12)
        if gain <= _CONVERGED * cost:
            break
    return problem.result(axis, equations)


def correlation_inflation(observations: CornerObservations, residuals: Floats) -> float:
    """
    Return the factor by which errors correlated between pictures inflate the sigma of a mean.

    Errors of the lens model displace a corner similarly in successive pictures. For a lag-one
    correlation r, n errors are equivalent to n (1 - r) / (1 + r) independent ones
    (Bartlett 1935).

    residuals : (n, 2) pixel
    returns : 1 or more
    """
    track = observations.group * (1 + int(observations.corner.max())) + observations.corner
    order = np.lexsort([observations.picture, track])
    same = np.diff(track[order]) == 0
    ordered = residuals[order]
    limit = 3.0 * float(np.median(np.abs(ordered))) / 0.6745
    ordered = np.clip(ordered, -limit, limit)
    products = (ordered[1:] * ordered[:-1])[same]
    r = float(np.clip(products.sum() / max((ordered**2)[1:][same].sum(), 1e-300), 0.0, 0.98))
    return float(np.sqrt((1 + r) / (1 - r)))


def _free_columns(start: AxisState, free: FreeAxisParameters) -> Ints:
    free_mask = np.zeros(_FIRST_GROUP + 3 * len(start.layout), dtype=bool)
    free_mask[:_BASE] = free.base
    free_mask[_TILT] = free.tilt
    free_mask[_SCALE] = free.scale
    free_mask[_BLOOM] = start.free_corners
    free_mask[_FIRST_GROUP:] = free.layout
    return np.flatnonzero(free_mask)


def apply_axis_step(axis: AxisState, common: Floats, angles: Floats) -> AxisState:
    """Apply a step of all common parameters and of the angles."""
    turn = np.asarray(cv2.Rodrigues(np.array([common[0], common[1], 0.0]))[0], dtype=np.float64)
    step = transforms.rigid(turn, common[2:_BASE])
    return replace(
        axis,
        camera_from_base=axis.camera_from_base @ step,
        tilt=axis.tilt + common[_TILT],
        scale=axis.scale + float(common[_SCALE]),
        bloom=axis.bloom + float(common[_BLOOM]),
        layout=axis.layout + common[_FIRST_GROUP:].reshape(-1, 3),
        angles=axis.angles + angles,
    )


def relative_size_u(axis: AxisState, covariance: Floats) -> float:
    """
    Return the relative standard uncertainty of ``AxisState.size``.

    covariance : (c, c) of the common parameters at this state; 0 for fixed ones
    """
    still, size = np.zeros(len(axis.angles)), len(covariance)
    gradient = np.zeros(size)
    for column in range(size):
        step = np.zeros(size)
        step[column] = _STEP
        ahead, behind = (apply_axis_step(axis, sign * step, still).size for sign in (1.0, -1.0))
        gradient[column] = (ahead - behind) / (2 * _STEP)
    variance = float(gradient @ covariance @ gradient)
    return math.sqrt(max(variance, 0.0)) / axis.size


@dataclass(frozen=True, eq=False)
class _NormalEquations:
    """Weighted normal equations: common (c) and angles (a, diagonal), coupling (ca)."""

    weights: Floats
    length_weights: Floats
    sigma: float
    cc: Floats
    aa: Floats
    ca: Floats
    gradient_c: Floats
    gradient_a: Floats
    cost: float


@dataclass(frozen=True, eq=False)
class _LeastSquaresProblem:
    observations: CornerObservations
    focal: Floats
    platter_points: PlatterPoints
    side: float | None
    columns: Ints
    size: int
    inflation: float

    def residuals(self, axis: AxisState) -> tuple[Floats, Floats]:
        """Return the (n, 2) residuals in pixels and the (m,) of heights and lengths, in sigmas."""
        points = axis.corners_in_camera(self.observations)
        projected = (
            self.focal * points[:, :2] / points[:, 2:]
            + axis.bloom * self.observations.bloom_jacobian
        )
        pixels = self.observations.uv - projected
        lengths = [-axis.heights(self.platter_points.points_xyz) / self.platter_points.sigma]
        if axis.free_corners:
            lengths.append(-axis.layout[:, 2] / _CORNER_HEIGHT_STD)
            if self.side is not None:
                lengths.append(np.array([(self.side - axis.mean_side()) / _MEAN_SIDE_STD]))
        return pixels, np.concatenate(lengths)

    def linearize(self, axis: AxisState) -> _NormalEquations:
        pixels, lengths = self.residuals(axis)
        off = np.linalg.norm(pixels, axis=1)
        # the median distance of normal noise in two dimensions is 1.1774 sigma
        sigma = max(float(np.median(off)) / 1.1774, 1e-4)
        weights = np.minimum(1.0, _HUBER * 1.4142 * sigma / np.maximum(off, 1e-12))
        weights /= (self.inflation * sigma) ** 2
        J_pixels, J_lengths, J_angles = self._jacobians(axis)
        w = np.minimum(1.0, _HUBER / np.maximum(np.abs(lengths), 1e-12))
        W = np.repeat(weights, 2)
        flat = pixels.ravel()
        picture = np.repeat(self.observations.picture, 2)
        count = len(axis.angles)
        ca = np.zeros((J_pixels.shape[1], count))
        for row, column in enumerate(J_pixels.T):
            ca[row] = np.bincount(picture, W * column * J_angles, count)
        return _NormalEquations(
            weights=weights,
            length_weights=w,
            sigma=sigma,
            cc=J_pixels.T @ (W[:, None] * J_pixels) + J_lengths.T @ (w[:, None] * J_lengths),
            aa=np.asarray(np.bincount(picture, W * J_angles**2, count), dtype=np.float64),
            ca=ca,
            gradient_c=J_pixels.T @ (W * flat) + J_lengths.T @ (w * lengths),
            gradient_a=np.asarray(
                np.bincount(picture, W * J_angles * flat, count), dtype=np.float64
            ),
            cost=float(W @ flat**2 + w @ lengths**2),
        )

    def _jacobians(self, axis: AxisState) -> tuple[Floats, Floats, Floats]:
        """Return d(prediction)/d(common), (2n, c) and (m, c); d(prediction)/d(angle), (2n,)."""
        still = np.zeros(len(axis.angles))
        pixels, lengths = [], []
        for column in self.columns:
            unit = np.zeros(self.size)
            unit[column] = _STEP
            ahead = self.residuals(apply_axis_step(axis, unit, still))
            behind = self.residuals(apply_axis_step(axis, -unit, still))
            pixels.append((behind[0] - ahead[0]).ravel() / (2 * _STEP))
            lengths.append((behind[1] - ahead[1]) / (2 * _STEP))
        none = np.zeros(self.size)
        ahead = self.residuals(apply_axis_step(axis, none, still + _STEP))
        behind = self.residuals(apply_axis_step(axis, none, still - _STEP))
        J_angles = (behind[0] - ahead[0]).ravel() / (2 * _STEP)
        shape = (2 * len(self.observations), 0)
        J_pixels = np.stack(pixels, axis=1) if pixels else np.zeros(shape)
        J_lengths = np.stack(lengths, axis=1) if lengths else np.zeros((len(ahead[1]), 0))
        return J_pixels, J_lengths, J_angles

    def cost(self, axis: AxisState, equations: _NormalEquations) -> float:
        pixels, lengths = self.residuals(axis)
        squared = equations.length_weights @ lengths**2
        return float(equations.weights @ (pixels**2).sum(axis=1) + squared)

    def step(self, equations: _NormalEquations, damping: float) -> tuple[Floats, Floats]:
        aa = equations.aa * (1 + damping) + 1e-300
        cc = equations.cc + damping * np.diag(np.diag(equations.cc))
        reduced = cc - (equations.ca / aa) @ equations.ca.T
        common = _solve(reduced, equations.gradient_c - equations.ca @ (equations.gradient_a / aa))
        angles = (equations.gradient_a - equations.ca.T @ common) / aa
        full = np.zeros(self.size)
        full[self.columns] = common
        return full, angles

    def result(self, axis: AxisState, equations: _NormalEquations) -> AxisAdjustment:
        aa = equations.aa + 1e-300
        reduced = equations.cc - (equations.ca / aa) @ equations.ca.T
        # base and layout may rotate against each other (gauge freedom): pseudo-inverse
        covariance = np.zeros((len(self.columns), len(self.columns)))
        if len(self.columns):
            covariance = _pseudo_inverse(reduced)
        full = np.zeros((self.size, self.size))
        full[np.ix_(self.columns, self.columns)] = covariance
        coupling = equations.ca / aa
        angle_variance = 1 / aa + np.einsum('ca,cd,da->a', coupling, covariance, coupling)
        return AxisAdjustment(
            axis=axis,
            covariance=full[:_BASE, :_BASE],
            size_u=relative_size_u(axis, full),
            angle_std=np.sqrt(angle_variance),
            tilt_covariance=full[_TILT, _TILT],
            residuals=self.residuals(axis)[0],
            sigma=equations.sigma,
        )


def _scaled(matrix: Floats) -> tuple[Floats, Floats]:
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    return matrix / np.outer(scale, scale), scale


def _solve(matrix: Floats, right: Floats) -> Floats:
    if len(right) == 0:
        return right
    scaled, scale = _scaled(matrix)
    return np.asarray(np.linalg.lstsq(scaled, right / scale, rcond=1e-12)[0] / scale)


def _pseudo_inverse(matrix: Floats) -> Floats:
    scaled, scale = _scaled(matrix)
    return np.asarray(np.linalg.pinv(scaled, rcond=1e-10, hermitian=True) / np.outer(scale, scale))
