# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Camera intrinsics from pictures of a board (Zhang 2000), with outlier views removed."""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace

import cv2
import numpy as np

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board import Corners
from ivfmc_ros.calibration.boards.board_shape import BoardShape
from ivfmc_ros.calibration.boards.views import BoardView
from ivfmc_ros.calibration.boards.views import BoardViews
from ivfmc_ros.calibration.boards.views import picture_name
from ivfmc_ros.calibration.camera.bundle import adjust
from ivfmc_ros.calibration.camera.bundle import BundleState
from ivfmc_ros.calibration.camera.bundle import FreeParameters
from ivfmc_ros.calibration.camera.bundle import INTRINSICS
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.camera import DISTORTION_COEFFICIENTS
from ivfmc_ros.errors import CalibrationError
from ivfmc_ros.errors import CellError
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.validation import require_one_of

MIN_VIEWS = 6
# A view is an outlier if its rms exceeds this multiple of the median over all views
_OUTLIER_VIEW_FACTOR = 2.0
# and this many pixels: a strongly tilted board is blurred, but constrains the focal length most.
_MIN_OUTLIER_RMS = 0.08
# Least angle in degrees between two views: focal length and distance separate by tilt.
_MIN_TILT_DEG = 10.0
# Greatest relative standard deviation of the focal lengths.
_MAX_FOCAL_STD = 0.01
# A bend is estimated if it is significant (Wald test, chi2 with 3 degrees of freedom: p < 2e-6)
_BEND_CHI2 = 30.0
# and larger than this fraction of the board's diagonal, with at least so many views.
_MIN_BEND = 5e-4
_BEND_MIN_VIEWS = 10
# Stretch of the print from which the user is warned: 0.05 %.
_MAX_STRETCH = 5e-4
_COVERAGE_GRID = 8  # cells per side
# Indices of p1, p2 and of k3 in the intrinsics: set to zero where they are not significant.
_OPTIONAL = ((6, 7), (8,))
# chi2 of 3 sigma by degrees of freedom
_CHI2 = {1: 9.0, 2: 11.8}


@dataclass(frozen=True, eq=False, kw_only=True)
class CameraCalibration:
    """
    Result of a camera calibration.

    used : views of the final adjustment
    dropped : reason by name of each picture that was not used
    rms, view_rms : pixel, of the reprojection errors; ``view_rms`` in the order of ``used``
    residuals : (n, 2) pixel of each used view, observed minus projected
    poses : (views, 6) rotation vector and translation in meters, board to camera
    std : 1 sigma of each intrinsic parameter, cluster-robust
    coverage : fraction of the cells of an 8 x 8 grid over the picture that contain a corner
    warnings : one line each, for the operator
    """

    camera: Camera
    board: Board
    board_shape: BoardShape
    used: tuple[BoardView, ...]
    dropped: dict[str, str]
    rms: float
    view_rms: Floats
    residuals: tuple[Floats, ...]
    poses: Floats
    std: dict[str, float]
    coverage: float
    warnings: tuple[str, ...]


def calibrate_camera(
    board: Board,
    views: BoardViews,
    model: str = 'plumb_bob',
    *,
    fit_bend: bool = True,
    square: bool = True,
    where: str = 'pictures',
) -> CameraCalibration:
    """
    Estimate intrinsics and lens distortion.

    views : detections of ``board``
    model : distortion model, plumb_bob or rational_polynomial
    fit_bend : whether the bend of the board is estimated, if it is significant
    square : keep fx = fy and estimate the anisotropic scale of the print instead
    where : folder of the pictures, for messages
    :raises CalibrationError: too few or too similar views, or an unknown model
    """
    require_one_of('model', model, DISTORTION_COEFFICIENTS, error=CalibrationError)
    free = FreeParameters(square=square, fit_stretch=square, fit_bend=fit_bend)
    used, bundle = _adjust_inlier_views(board, views, model, free, where)
    bundle = _drop_insignificant_distortion(board, [view.corners for view in used], bundle, free)
    _require_determined(bundle, where)
    camera = _camera(bundle, views.size, model, where)
    std = np.sqrt(np.diag(bundle.covariance)[: len(bundle.intrinsics)])
    kept = {view.path for view in used}
    dropped = {picture_name(path): 'board not detected' for path in views.missed}
    dropped |= {v.name: 'large residuals' for v in views.found if v.path not in kept}
    cells = _covered_cells(used, views.size, _COVERAGE_GRID)
    return CameraCalibration(
        camera=camera,
        board=board,
        board_shape=bundle.board_shape,
        used=tuple(used),
        dropped=dropped,
        rms=bundle.rms,
        view_rms=bundle.view_rms,
        residuals=bundle.residuals,
        poses=bundle.poses,
        std=dict(zip(INTRINSICS, std.tolist(), strict=False)),
        coverage=float(cells.mean()),
        warnings=tuple(_warnings(board, bundle, used, views.size)),
    )


def _adjust_inlier_views(
    board: Board, views: BoardViews, model: str, free: FreeParameters, where: str
) -> tuple[list[BoardView], BundleState]:
    """Adjust and remove outlier views until there are none."""
    used = list(views.found)
    _require_enough(used, where)
    bundle = _initial_state(board, views, model, free.square, where)
    while True:
        corners = [view.corners for view in used]
        bundle = adjust_with_shape(board, corners, bundle, free)
        good = inlier_views(bundle.view_rms)
        if good.all():
            return used, bundle
        used = [view for view, is_good in zip(used, good, strict=True) if is_good]
        _require_enough(used, where)
        bundle = replace(bundle, poses=bundle.poses[good], residuals=())


def _drop_insignificant_distortion(
    board: Board, corners: Sequence[Corners], bundle: BundleState, free: FreeParameters
) -> BundleState:
    """
    Set distortion coefficients to zero that are not significant (Wald tests).

    Insignificant tangential coefficients move the principal point by up to a pixel.
    """
    fixed: tuple[int, ...] = ()
    for group in _OPTIONAL:
        index = list(group)
        values, covariance = bundle.intrinsics[index], bundle.covariance[np.ix_(index, index)]
        if values @ np.linalg.lstsq(covariance, values, rcond=None)[0] < _CHI2[len(index)]:
            fixed += group
            intrinsics = bundle.intrinsics.copy()
            intrinsics[index] = 0.0
            start = replace(bundle, intrinsics=intrinsics)
            bundle = adjust_with_shape(board, corners, start, replace(free, fixed=fixed))
    return bundle


def inlier_views(view_rms: Floats) -> Bools:
    """Return (views,) bool: false for views whose rms, (views,) pixel, is an outlier."""
    return np.asarray(
        view_rms <= max(_OUTLIER_VIEW_FACTOR * float(np.median(view_rms)), _MIN_OUTLIER_RMS)
    )


def adjust_with_shape(
    board: Board, corners: Sequence[Corners], start: BundleState, free: FreeParameters
) -> BundleState:
    """
    Adjust with a flat board, or with a bent one where ``free`` allows it and it is significant.

    A bend is significant by a Wald test with the cluster-robust covariance, and if its sag is
    more than 0.05 % of the board's diagonal.
    """
    start = replace(start, board_shape=BoardShape.flat(board), residuals=())
    enough = len(corners) >= _BEND_MIN_VIEWS
    flat = adjust(board, corners, start, replace(free, fit_bend=False))
    if not (free.fit_bend and enough):
        return flat
    bent = adjust(board, corners, flat, free)
    return bent if _is_bent(board, bent) else flat


def _is_bent(board: Board, bent: BundleState) -> bool:
    c = bent.board_shape.coefficients[:3]
    chi2 = c @ np.linalg.lstsq(bent.covariance[-4:-1, -4:-1], c, rcond=None)[0]
    diagonal = np.linalg.norm(np.ptp(board.corners_xyz, axis=0))
    return bool(chi2 > _BEND_CHI2 and bent.board_shape.sag(board) > _MIN_BEND * diagonal)


def _initial_state(
    board: Board, views: BoardViews, model: str, square: bool, where: str
) -> BundleState:
    corners = [view.corners for view in views.found]
    points = [board.corners_xyz[view.ids].astype(np.float32) for view in corners]
    pixels = [view.uv.astype(np.float32).reshape(-1, 1, 2) for view in corners]
    flags = cv2.CALIB_RATIONAL_MODEL if model == 'rational_polynomial' else 0
    start = (np.eye(3), np.zeros(8 if flags else 5))
    try:
        _, K, distortion, turns, shifts = cv2.calibrateCamera(
            points, pixels, views.size, *start, flags=flags
        )
    except cv2.error as error:
        raise _too_similar(where) from error
    if not (np.isfinite(K).all() and np.isfinite(distortion).all()):
        raise _too_similar(where)
    if square:
        K[0, 0] = K[1, 1] = 0.5 * (K[0, 0] + K[1, 1])
    coefficients = np.ravel(distortion)[: DISTORTION_COEFFICIENTS[model]]
    poses = np.hstack([np.reshape(turns, (-1, 3)), np.reshape(shifts, (-1, 3))])
    return BundleState(
        intrinsics=np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *coefficients]),
        board_shape=BoardShape.flat(board),
        poses=np.asarray(poses, dtype=np.float64),
        covariance=np.zeros((0, 0)),
        residuals=(),
    )


def _require_enough(used: Sequence[BoardView], where: str) -> None:
    if len(used) < MIN_VIEWS:
        raise CalibrationError(
            f'{where}: {len(used)} usable pictures of the board, at least {MIN_VIEWS} are needed; '
            'take 20 or more with the board tilted in different directions'
        )


def _require_determined(bundle: BundleState, where: str) -> None:
    normals = np.array([cv2.Rodrigues(pose[:3])[0][:, 2] for pose in bundle.poses])
    cosines = np.clip(normals @ normals.T, -1, 1)
    tilt = np.degrees(np.arccos(cosines.min()))
    focal_std = np.sqrt(np.diag(bundle.covariance)[:2]) / bundle.intrinsics[:2]
    if tilt < _MIN_TILT_DEG or not focal_std.max() < _MAX_FOCAL_STD:
        raise _too_similar(where)


def _too_similar(where: str) -> CalibrationError:
    return CalibrationError(
        f'{where}: the views of the board are too parallel to separate focal length and '
        'distance; tilt the board by 30 degrees or more, in different directions'
    )


def _camera(bundle: BundleState, size: tuple[int, int], model: str, where: str) -> Camera:
    try:
        return Camera(
            width=size[0],
            height=size[1],
            K=bundle.matrix,
            distortion=bundle.distortion,
            model=model,
        )
    except CellError as error:
        raise CalibrationError(
            f'{where}: the calibration gives an invalid camera: {error}'
        ) from error


def _covered_cells(used: Sequence[BoardView], size: tuple[int, int], grid: int) -> Bools:
    uv = np.concatenate([view.corners.uv for view in used])
    edges = [np.linspace(-0.5, length - 0.5, grid + 1) for length in (size[1], size[0])]
    return np.asarray(np.histogram2d(uv[:, 1], uv[:, 0], bins=edges)[0] > 0)


def _warnings(
    board: Board, bundle: BundleState, used: Sequence[BoardView], size: tuple[int, int]
) -> list[str]:
    warnings = []
    corner = _covered_cells(used, size, 4)
    places = {'upper left': (0, 0), 'upper right': (0, 3), 'lower left': (3, 0)}
    places['lower right'] = (3, 3)
    empty = [name for name, cell in places.items() if not corner[cell]]
    if empty:
        warnings.append(
            f'no picture shows the board in the {", ".join(empty)} of the image; '
            'the distortion there is extrapolated'
        )
    if not bundle.board_shape.is_flat:
        warnings.append(
            f'the board is bent by {bundle.board_shape.sag(board) * 1e3:.2f} mm; '
            'the calibration accounts for it, but a flat board is more accurate'
        )
    if abs(bundle.board_shape.stretch) > _MAX_STRETCH:
        warnings.append(
            f'the squares are {bundle.board_shape.stretch * 100:+.2f} % longer along the columns '
            'than along the rows, or the pixels are not square (then use --no-square-pixels); '
            'measure the board in both directions'
        )
    return warnings
