# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Bundle adjustment of camera intrinsics, board poses and board shape (Zhang 2000).

The parameters common to all pictures (intrinsics, shape) are solved with the poses eliminated
(Schur complement). Their covariance treats each picture as one observation, because the corners
of one picture share its blur and the print error (cluster-robust sandwich, Liang & Zeger 1986).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace

import cv2
import numpy as np

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board import Corners
from ivfmc_ros.calibration.boards.board_shape import BoardShape
from ivfmc_ros.model import Floats

_MAX_ITERATIONS = 50
# relative decrease of the cost at which the iteration stops
_CONVERGED = 1e-10
# median of a squared standard normal variable
_MEDIAN_CHI2 = 0.4549
# names of the parameters in OpenCV's order
INTRINSICS = ('fx', 'fy', 'cx', 'cy', 'k1', 'k2', 'p1', 'p2', 'k3', 'k4', 'k5', 'k6')


@dataclass(frozen=True, eq=False, kw_only=True)
class BundleState:
    """
    Parameters and residuals of the adjustment.

    intrinsics : (4 + distortion,) fx, fy, cx, cy, distortion in OpenCV's order
    poses : (views, 6) rotation vector and translation, board to camera
    covariance : (c, c) of intrinsics, then shape, cluster-robust; 0 for fixed parameters
    residuals : for each view (n, 2) pixel, observed minus projected
    """

    intrinsics: Floats
    board_shape: BoardShape
    poses: Floats
    covariance: Floats
    residuals: tuple[Floats, ...]

    @property
    def matrix(self) -> Floats:
        """(3, 3) camera matrix, pixel."""
        fx, fy, cx, cy = self.intrinsics[:4]
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @property
    def distortion(self) -> Floats:
        """(n,) distortion coefficients."""
        return self.intrinsics[4:]

    @property
    def rms(self) -> float:
        """Root mean square of the reprojection errors, pixel."""
        squared = np.concatenate([(r**2).sum(axis=1) for r in self.residuals])
        return float(np.sqrt(squared.mean()))

    @property
    def view_rms(self) -> Floats:
        """(views,) rms of each view, pixel."""
        return np.array([np.sqrt((r**2).sum(axis=1).mean()) for r in self.residuals])


@dataclass(frozen=True, eq=False, kw_only=True)
class FreeParameters:
    """
    Parameters that the adjustment estimates besides the poses.

    square : keep fx = fy
    fixed : indices of intrinsics that are not estimated
    fit_stretch : anisotropic scale of the board; not separable from fx / fy
    fit_bend : bend of the board
    """

    intrinsics: bool = True
    square: bool = True
    fixed: tuple[int, ...] = ()
    fit_stretch: bool = False
    fit_bend: bool = False

    def expansion(self, intrinsics: int) -> Floats:
        """Return (intrinsics + 4, free): matrix from the free to all common parameters."""
        free = np.eye(intrinsics + 4)
        keep = np.zeros(intrinsics + 4, dtype=bool)
        keep[:intrinsics] = self.intrinsics
        if self.intrinsics and self.square:
            free[1, 0], keep[1] = 1.0, False
        keep[list(self.fixed)] = False
        keep[intrinsics:] = [self.fit_bend] * 3 + [self.fit_stretch]
        return free[:, keep]


def adjust(
    board: Board, views: Sequence[Corners], start: BundleState, free: FreeParameters
) -> BundleState:
    """
    Minimize the squared reprojection errors (Levenberg-Marquardt).

    start : initial intrinsics, shape and poses
    """
    current, equations = start, _NormalEquations.build(board, views, start, free)
    damping = 1e-4
    for _ in range(_MAX_ITERATIONS):
        common, poses = equations.step(damping)
        trial = _apply_step(current, common, poses)
        trial_equations = _NormalEquations.build(board, views, trial, free)
        gain = equations.cost - trial_equations.cost
        if gain < 0:
            damping = min(damping * 10, 1e8)
            continue
        current, equations, damping = trial, trial_equations, max(damping / 10, 1e-12)
        if gain <= _CONVERGED * equations.cost:
            break
    return replace(
        current, covariance=equations.covariance(), residuals=tuple(equations.residuals_uv)
    )


def _apply_step(bundle: BundleState, common: Floats, poses: Floats) -> BundleState:
    count = len(bundle.intrinsics)
    board_shape = replace(
        bundle.board_shape, coefficients=bundle.board_shape.coefficients + common[count:]
    )
    intrinsics = bundle.intrinsics + common[:count]
    return replace(
        bundle, intrinsics=intrinsics, board_shape=board_shape, poses=bundle.poses + poses
    )


@dataclass(frozen=True, eq=False)
class _NormalEquations:
    """Normal equations: common (c), and for each view its pose (p), coupling (cp), gradients."""

    expansion: Floats
    cc: Floats
    pp: Floats
    cp: Floats
    gradient_c: Floats
    gradient_p: Floats
    scores_c: Floats
    residuals_uv: list[Floats]
    cost: float

    @classmethod
    def build(
        cls, board: Board, views: Sequence[Corners], bundle: BundleState, free: FreeParameters
    ) -> '_NormalEquations':
        corners = bundle.board_shape.corners_xyz(board)
        parts = [
            _linearize(board.corners_xyz[view.ids], corners[view.ids], view.uv, bundle, pose)
            for view, pose in zip(views, bundle.poses, strict=True)
        ]
        expansion = free.expansion(len(bundle.intrinsics))
        residuals = [part[0] for part in parts]
        Jc, Jp = [part[1] @ expansion for part in parts], [part[2] for part in parts]
        flat = [r.ravel() for r in residuals]
        scores = np.array([J.T @ r for J, r in zip(Jc, flat, strict=True)])
        return cls(
            expansion=expansion,
            cc=np.sum([J.T @ J for J in Jc], axis=0),
            pp=np.array([J.T @ J for J in Jp]),
            cp=np.array([A.T @ B for A, B in zip(Jc, Jp, strict=True)]),
            gradient_c=scores.sum(axis=0),
            gradient_p=np.array([J.T @ r for J, r in zip(Jp, flat, strict=True)]),
            scores_c=scores,
            residuals_uv=residuals,
            cost=float(sum(r @ r for r in flat)),
        )

    def step(self, damping: float) -> tuple[Floats, Floats]:
        """Return the damped step of the common parameters, (c,), and of the poses, (views, 6)."""
        index = np.arange(6)
        pp = self.pp.copy()
        pp[:, index, index] *= 1 + damping
        cc = self.cc + damping * np.diag(np.diag(self.cc))
        reduced, scores = self._reduce(pp, cc)
        common = _solve(reduced, scores.sum(axis=0))
        right = self.gradient_p - np.einsum('vcp,c->vp', self.cp, common)
        return self.expansion @ common, np.linalg.solve(pp, right[..., None])[..., 0]

    def covariance(self) -> Floats:
        """Return the sandwich covariance of the common parameters, one cluster per view."""
        reduced, scores = self._reduce(self.pp, self.cc)
        bread = np.linalg.pinv(reduced, rcond=1e-15, hermitian=True)
        views = len(scores)
        meat = scores.T @ scores * views / max(views - 1, 1)
        return np.asarray(self.expansion @ bread @ meat @ bread @ self.expansion.T)

    def _reduce(self, pp: Floats, cc: Floats) -> tuple[Floats, Floats]:
        """Eliminate the poses: (c, c) matrix and (views, c) gradients of each view."""
        gain = np.linalg.solve(pp, np.swapaxes(self.cp, 1, 2))  # (views, 6, c)
        reduced = cc - np.einsum('vcp,vpd->cd', self.cp, gain)
        scores = self.scores_c - np.einsum('vp,vpc->vc', self.gradient_p, gain)
        return reduced, scores


def _solve(matrix: Floats, right: Floats) -> Floats:
    # parameters differ by orders of magnitude (fx, k3): scale before solving
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix / np.outer(scale, scale)
    return np.asarray(np.linalg.lstsq(scaled, right / scale, rcond=1e-13)[0] / scale)


def _linearize(
    nominal: Floats, corners: Floats, uv: Floats, bundle: BundleState, pose: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return (n, 2) residuals and the (2n, c) and (2n, 6) Jacobians of the projections."""
    projected, J = cv2.projectPoints(corners, pose[:3], pose[3:], bundle.matrix, bundle.distortion)
    residuals = uv - projected.reshape(-1, 2)
    # a shift of a corner in the board frame is a rotated shift of the translation
    R, _ = cv2.Rodrigues(pose[:3])
    by_corner = (J[:, 3:6] @ R).reshape(-1, 2, 3)
    by_shape = (by_corner @ bundle.board_shape.jacobian(nominal[:, :2])).reshape(-1, 4)
    by_intrinsics = J[:, 6 : 6 + len(bundle.intrinsics)]
    common = np.hstack([by_intrinsics, by_shape])
    return np.asarray(residuals), np.asarray(common), np.asarray(J[:, :6], dtype=np.float64)


def pose_covariances(board: Board, views: Sequence[Corners], bundle: BundleState) -> Floats:
    """Return (views, 6, 6): covariance of each pose for known common parameters."""
    corners = bundle.board_shape.corners_xyz(board)
    squared = np.concatenate([np.ravel(r) ** 2 for r in bundle.residuals])
    # one variance for all views, robust against single bad ones
    variance = float(np.median(squared)) / _MEDIAN_CHI2
    normal = [
        _linearize(board.corners_xyz[view.ids], corners[view.ids], view.uv, bundle, pose)[2]
        for view, pose in zip(views, bundle.poses, strict=True)
    ]
    return np.array([np.linalg.inv(J.T @ J) * variance for J in normal])
