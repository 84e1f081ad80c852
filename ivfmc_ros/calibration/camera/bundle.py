# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Joint least-squares adjustment of camera, board poses and board shape (Zhang 2000).

What is common to all pictures (intrinsics, shape) is solved with the poses eliminated (Schur
complement). Its covariance takes each picture as one observation, because the corners of one
picture share its blur and its error of print (cluster-robust sandwich, Liang & Zeger 1986).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace

import cv2
import numpy as np

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board import Corners
from ivfmc_ros.calibration.camera.bow import Bend
from ivfmc_ros.model import Floats

_MAX_STEPS = 50
_CONVERGED = 1e-10
# median of a squared standard normal variable
_MEDIAN_CHI2 = 0.4549
INTRINSICS = ('fx', 'fy', 'cx', 'cy', 'k1', 'k2', 'p1', 'p2', 'k3', 'k4', 'k5', 'k6')


@dataclass(frozen=True, eq=False, kw_only=True)
class Bundle:
    """
    An adjusted set of views.

    intrinsics : (4 + distortion,) fx, fy, cx, cy, distortion in OpenCV's order
    poses : (views, 6) rotation vector and translation, board to camera
    covariance : (c, c) of intrinsics, then shape, cluster-robust; 0 where nothing was free
    residuals : for each view (n, 2) pixel, seen minus expected
    """

    intrinsics: Floats
    bend: Bend
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
        """Root mean square of the distances between corners seen and expected, pixel."""
        squared = np.concatenate([(r**2).sum(axis=1) for r in self.residuals])
        return float(np.sqrt(squared.mean()))

    @property
    def view_rms(self) -> Floats:
        """(views,) rms of each view, pixel."""
        return np.array([np.sqrt((r**2).sum(axis=1).mean()) for r in self.residuals])


@dataclass(frozen=True, eq=False, kw_only=True)
class Free:
    """
    What an adjustment may change besides the poses.

    square : keep fx = fy; what of a print is longer one way is then the board's stretch
    held : indices of intrinsics that stay what they are
    stretch, bend : of the board
    """

    intrinsics: bool = True
    square: bool = True
    held: tuple[int, ...] = ()
    stretch: bool = False
    bend: bool = False

    def lift(self, intrinsics: int) -> Floats:
        """Return (intrinsics + 4, free): all common parameters from the free ones."""
        free = np.eye(intrinsics + 4)
        keep = np.zeros(intrinsics + 4, dtype=bool)
        keep[:intrinsics] = self.intrinsics
        if self.intrinsics and self.square:
            free[1, 0], keep[1] = 1.0, False
        keep[list(self.held)] = False
        keep[intrinsics:] = [self.bend] * 3 + [self.stretch]
        return free[:, keep]


def adjust(board: Board, views: Sequence[Corners], start: Bundle, free: Free) -> Bundle:
    """
    Minimise the squared distances between corners seen and expected (Levenberg-Marquardt).

    start : intrinsics, bend and poses to begin with; must be near
    """
    current, system = start, _System.build(board, views, start, free)
    damping = 1e-4
    for _ in range(_MAX_STEPS):
        common, poses = system.step(damping)
        trial = _moved(current, common, poses)
        trial_system = _System.build(board, views, trial, free)
        gain = system.cost - trial_system.cost
        if gain < 0:
            damping = min(damping * 10, 1e8)
            continue
        current, system, damping = trial, trial_system, max(damping / 10, 1e-12)
        if gain <= _CONVERGED * system.cost:
            break
    return replace(current, covariance=system.covariance(), residuals=tuple(system.residuals_uv))


def _moved(bundle: Bundle, common: Floats, poses: Floats) -> Bundle:
    count = len(bundle.intrinsics)
    bend = replace(bundle.bend, coefficients=bundle.bend.coefficients + common[count:])
    intrinsics = bundle.intrinsics + common[:count]
    return replace(bundle, intrinsics=intrinsics, bend=bend, poses=bundle.poses + poses)


@dataclass(frozen=True, eq=False)
class _System:
    """Normal equations: common (c), and for each view its pose (p), coupling (cp), gradients."""

    lift: Floats
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
        cls, board: Board, views: Sequence[Corners], bundle: Bundle, free: Free
    ) -> '_System':
        corners = bundle.bend.corners_xyz(board)
        parts = [
            _linearise(board.corners_xyz[view.ids], corners[view.ids], view.uv, bundle, pose)
            for view, pose in zip(views, bundle.poses, strict=True)
        ]
        lift = free.lift(len(bundle.intrinsics))
        residuals = [part[0] for part in parts]
        Jc, Jp = [part[1] @ lift for part in parts], [part[2] for part in parts]
        flat = [r.ravel() for r in residuals]
        scores = np.array([J.T @ r for J, r in zip(Jc, flat, strict=True)])
        return cls(
            lift=lift,
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
        """Return the change of the common parameters, (c,), and of the poses, (views, 6)."""
        index = np.arange(6)
        pp = self.pp.copy()
        pp[:, index, index] *= 1 + damping
        cc = self.cc + damping * np.diag(np.diag(self.cc))
        reduced, scores = self._reduce(pp, cc)
        common = _solve(reduced, scores.sum(axis=0))
        right = self.gradient_p - np.einsum('vcp,c->vp', self.cp, common)
        return self.lift @ common, np.linalg.solve(pp, right[..., None])[..., 0]

    def covariance(self) -> Floats:
        """Return the sandwich of the common parameters, one cluster a view."""
        reduced, scores = self._reduce(self.pp, self.cc)
        bread = np.linalg.pinv(reduced, rcond=1e-15, hermitian=True)
        views = len(scores)
        meat = scores.T @ scores * views / max(views - 1, 1)
        return np.asarray(self.lift @ bread @ meat @ bread @ self.lift.T)

    def _reduce(self, pp: Floats, cc: Floats) -> tuple[Floats, Floats]:
        """Eliminate the poses: (c, c) matrix and (views, c) gradients of each view."""
        gain = np.linalg.solve(pp, np.swapaxes(self.cp, 1, 2))  # (views, 6, c)
        reduced = cc - np.einsum('vcp,vpd->cd', self.cp, gain)
        scores = self.scores_c - np.einsum('vp,vpc->vc', self.gradient_p, gain)
        return reduced, scores


def _solve(matrix: Floats, right: Floats) -> Floats:
    # parameters differ by orders of magnitude (pixels, k3): scale before solving
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix / np.outer(scale, scale)
    return np.asarray(np.linalg.lstsq(scaled, right / scale, rcond=1e-13)[0] / scale)


def _linearise(
    nominal: Floats, corners: Floats, uv: Floats, bundle: Bundle, pose: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return (n, 2) residuals and the (2n, c) and (2n, 6) derivatives of the projections."""
    expected, J = cv2.projectPoints(corners, pose[:3], pose[3:], bundle.matrix, bundle.distortion)
    residuals = uv - expected.reshape(-1, 2)
    # moving a corner in the board's frame is moving the board by as much, turned
    R, _ = cv2.Rodrigues(pose[:3])
    by_corner = (J[:, 3:6] @ R).reshape(-1, 2, 3)
    by_shape = (by_corner @ bundle.bend.derivatives(nominal[:, :2])).reshape(-1, 4)
    by_intrinsics = J[:, 6 : 6 + len(bundle.intrinsics)]
    common = np.hstack([by_intrinsics, by_shape])
    return np.asarray(residuals), np.asarray(common), np.asarray(J[:, :6], dtype=np.float64)


def pose_covariances(board: Board, views: Sequence[Corners], bundle: Bundle) -> Floats:
    """Return (views, 6, 6): covariance of each pose, the common parameters taken as known."""
    corners = bundle.bend.corners_xyz(board)
    squared = np.concatenate([np.ravel(r) ** 2 for r in bundle.residuals])
    # one variance for all views: a robust one, since the odd view is worse than the others
    variance = float(np.median(squared)) / _MEDIAN_CHI2
    normal = [
        _linearise(board.corners_xyz[view.ids], corners[view.ids], view.uv, bundle, pose)[2]
        for view, pose in zip(views, bundle.poses, strict=True)
    ]
    return np.array([np.linalg.inv(J.T @ J) * variance for J in normal])
