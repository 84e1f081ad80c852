# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Joint adjustment of table axis, marker layout and the table angle of every picture.

Unknown are the axis, where things lie on the platter, by how much the platter is tilted to the
axis, the angle of every picture, and the scale if the lengths of board or markers are not
believed. Stripe points of the bare platter, which the calibrated laser puts into space in metres,
then give the scale. The angles are eliminated (Schur complement); outliers get less weight
(Huber 1964).
"""

from dataclasses import dataclass
from dataclasses import replace

import cv2
import numpy as np

from ivfmc_ros.calibration.turntable.axis import Axis
from ivfmc_ros.calibration.turntable.axis import Heights
from ivfmc_ros.calibration.turntable.axis import Sightings
from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

_MAX_STEPS = 60
_CONVERGED = 1e-9
_STEP = 1e-6
# Huber's constant: 95 % as efficient as least squares where noise is normal
_HUBER = 1.345
# How far corners of single markers may stand off the platter, metres: paper curls.
_CURL = 3e-4
# How exactly the mean side of single markers is what it is said to be, if that gives the scale.
_SIDE = 1e-5
# ωx, ωy, translation of the base; platter's tilt; scale; bloom
_BASE = 5
_TILT = slice(5, 7)
_SCALE = 7
_BLOOM = 8
_FIRST_GROUP = 9


@dataclass(frozen=True, kw_only=True)
class FreeAxis:
    """
    What the adjustment may change besides the angles.

    side : metres, what the mean side of free markers must be; None if stripes give the scale
    """

    side: float | None = None
    scale: bool = False
    layout: bool = True
    base: bool = True
    tilt: bool = True


@dataclass(frozen=True, eq=False, kw_only=True)
class Adjusted:
    """
    What came out.

    covariance : (5, 5) of the base: rotation about its x and y, translation in its axes
    angle_std : (pictures,) radians
    tilt_covariance : (2, 2)
    scale_std : 1 sigma of the scale
    residuals : (n, 2) pixel, seen minus expected
    sigma : pixel, robust standard deviation of a coordinate
    """

    axis: Axis
    covariance: Floats
    angle_std: Floats
    tilt_covariance: Floats
    scale_std: float
    residuals: Floats
    sigma: float


def adjust_axis(
    start: Axis,
    sightings: Sightings,
    focal: Floats,
    free: FreeAxis,
    heights: Heights,
    inflation: float = 1.0,
) -> Adjusted:
    """
    Minimise robustly the distances of corners and stripe points (Levenberg-Marquardt, Huber).

    focal : (2,) pixel
    inflation : of the corners' sigma, for errors that are alike in one picture and the next
    """
    size = _FIRST_GROUP + start.layout.size
    problem = _Problem(
        sightings, focal, heights, free.side, _free_columns(start, free), size, inflation
    )
    axis, system, damping = start, problem.linearise(start), 1e-4
    for _ in range(_MAX_STEPS):
        trial = _moved(axis, *problem.step(system, damping))
        # weights and noise level are those of the last accepted state, so that costs compare
        cost = problem.cost(trial, system)
        gain = system.cost - cost
        if not gain >= 0:
            damping *= 10
            if damping > 1e10:
                break
            continue
        axis, system, damping = trial, problem.linearise(trial), max(damping / 10, 1e-12)
        if gain <= _CONVERGED * cost:
            break
    return problem.result(axis, system)


def likeness(sightings: Sightings, residuals: Floats) -> float:
    """
    Return by how much errors that repeat from picture to picture inflate the sigma of a mean.

    A lens that is not quite known moves a corner alike in one picture and the next. Of errors
    with correlation r from one to the next, n tell as much as n (1 - r) / (1 + r) independent
    ones (Bartlett 1935).

    residuals : (n, 2) pixel
    returns : 1 or more
    """
    track = sightings.group * (1 + int(sightings.corner.max())) + sightings.corner
    order = np.lexsort([sightings.picture, track])
    same = np.diff(track[order]) == 0
    ordered = residuals[order]
    limit = 3.0 * float(np.median(np.abs(ordered))) / 0.6745
    ordered = np.clip(ordered, -limit, limit)
    products = (ordered[1:] * ordered[:-1])[same]
    r = float(np.clip(products.sum() / max((ordered**2)[1:][same].sum(), 1e-300), 0.0, 0.98))
    return float(np.sqrt((1 + r) / (1 - r)))


def _free_columns(start: Axis, free: FreeAxis) -> Ints:
    wanted = np.zeros(_FIRST_GROUP + 3 * len(start.layout), dtype=bool)
    wanted[:_BASE] = free.base
    wanted[_TILT] = free.tilt
    wanted[_SCALE] = free.scale
    wanted[_BLOOM] = start.free
    wanted[_FIRST_GROUP:] = free.layout
    return np.flatnonzero(wanted)


def _moved(axis: Axis, common: Floats, angles: Floats) -> Axis:
    """Apply a full vector of common changes and the changes of the angles."""
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


@dataclass(frozen=True, eq=False)
class _System:
    """Weighted normal equations: common (c), angles (a, diagonal), coupling (ca)."""

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
class _Problem:
    sightings: Sightings
    focal: Floats
    heights: Heights
    side: float | None
    columns: Ints
    size: int
    inflation: float

    def residuals(self, axis: Axis) -> tuple[Floats, Floats]:
        """Return (n, 2) pixels, and (m,) lengths over their sigmas."""
        points = axis.camera_points(self.sightings)
        expected = self.focal * points[:, :2] / points[:, 2:] + axis.bloom * self.sightings.inward
        pixels = self.sightings.uv - expected
        lengths = [-axis.heights(self.heights.points_xyz) / self.heights.sigma]
        if axis.free:
            lengths.append(-axis.layout[:, 2] / _CURL)
            if self.side is not None:
                lengths.append(np.array([(self.side - axis.mean_side()) / _SIDE]))
        return pixels, np.concatenate(lengths)

    def linearise(self, axis: Axis) -> _System:
        pixels, lengths = self.residuals(axis)
        off = np.linalg.norm(pixels, axis=1)
        # the median distance of normal noise in two dimensions is 1.1774 sigma
        sigma = max(float(np.median(off)) / 1.1774, 1e-4)
        weights = np.minimum(1.0, _HUBER * 1.4142 * sigma / np.maximum(off, 1e-12))
        weights /= (self.inflation * sigma) ** 2
        J_pixels, J_lengths, J_angles = self._derivatives(axis)
        w = np.minimum(1.0, _HUBER / np.maximum(np.abs(lengths), 1e-12))
        W = np.repeat(weights, 2)
        flat = pixels.ravel()
        picture = np.repeat(self.sightings.picture, 2)
        count = len(axis.angles)
        ca = np.zeros((J_pixels.shape[1], count))
        for row, column in enumerate(J_pixels.T):
            ca[row] = np.bincount(picture, W * column * J_angles, count)
        return _System(
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

    def _derivatives(self, axis: Axis) -> tuple[Floats, Floats, Floats]:
        """Return d(expected)/d(common) (2n, c) and (m, c), d(expected)/d(angle) (2n,)."""
        still = np.zeros(len(axis.angles))
        pixels, lengths = [], []
        for column in self.columns:
            unit = np.zeros(self.size)
            unit[column] = _STEP
            ahead = self.residuals(_moved(axis, unit, still))
            behind = self.residuals(_moved(axis, -unit, still))
            pixels.append((behind[0] - ahead[0]).ravel() / (2 * _STEP))
            lengths.append((behind[1] - ahead[1]) / (2 * _STEP))
        none = np.zeros(self.size)
        ahead = self.residuals(_moved(axis, none, still + _STEP))
        behind = self.residuals(_moved(axis, none, still - _STEP))
        J_angles = (behind[0] - ahead[0]).ravel() / (2 * _STEP)
        shape = (2 * len(self.sightings), 0)
        J_pixels = np.stack(pixels, axis=1) if pixels else np.zeros(shape)
        J_lengths = np.stack(lengths, axis=1) if lengths else np.zeros((len(ahead[1]), 0))
        return J_pixels, J_lengths, J_angles

    def cost(self, axis: Axis, system: _System) -> float:
        pixels, lengths = self.residuals(axis)
        squared = system.length_weights @ lengths**2
        return float(system.weights @ (pixels**2).sum(axis=1) + squared)

    def step(self, system: _System, damping: float) -> tuple[Floats, Floats]:
        aa = system.aa * (1 + damping) + 1e-300
        cc = system.cc + damping * np.diag(np.diag(system.cc))
        reduced = cc - (system.ca / aa) @ system.ca.T
        common = _solve(reduced, system.gradient_c - system.ca @ (system.gradient_a / aa))
        angles = (system.gradient_a - system.ca.T @ common) / aa
        full = np.zeros(self.size)
        full[self.columns] = common
        return full, angles

    def result(self, axis: Axis, system: _System) -> Adjusted:
        aa = system.aa + 1e-300
        reduced = system.cc - (system.ca / aa) @ system.ca.T
        # turning base and layout against each other changes nothing: a pseudo-inverse
        covariance = np.zeros((len(self.columns), len(self.columns)))
        if len(self.columns):
            covariance = _pseudo_inverse(reduced)
        full = np.zeros((_FIRST_GROUP, _FIRST_GROUP))
        known = self.columns[self.columns < _FIRST_GROUP]
        full[np.ix_(known, known)] = covariance[: len(known), : len(known)]
        pull = system.ca / aa
        angle_variance = 1 / aa + np.einsum('ca,cd,da->a', pull, covariance, pull)
        return Adjusted(
            axis=axis,
            covariance=full[:_BASE, :_BASE],
            angle_std=np.sqrt(angle_variance),
            tilt_covariance=full[_TILT, _TILT],
            scale_std=float(np.sqrt(full[_SCALE, _SCALE])),
            residuals=self.residuals(axis)[0],
            sigma=system.sigma,
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
