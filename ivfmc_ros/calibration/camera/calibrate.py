# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Camera intrinsics from pictures of a board (Zhang 2000), robust to bad pictures."""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace

import cv2
import numpy as np

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board import Corners
from ivfmc_ros.calibration.boards.views import name_of
from ivfmc_ros.calibration.boards.views import View
from ivfmc_ros.calibration.boards.views import Views
from ivfmc_ros.calibration.camera.bow import Bend
from ivfmc_ros.calibration.camera.bundle import adjust
from ivfmc_ros.calibration.camera.bundle import Bundle
from ivfmc_ros.calibration.camera.bundle import Free
from ivfmc_ros.calibration.camera.bundle import INTRINSICS
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.camera import DISTORTION_COEFFICIENTS
from ivfmc_ros.errors import CalibrationError
from ivfmc_ros.errors import CellError
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.validation import require_one_of

MIN_VIEWS = 6
# A view is bad if its rms is more than this many times the median of all.
_BAD_VIEW = 2.0
# and more than this, pixels: a strongly tilted board is seen less sharply, and tells the most.
_GOOD_ENOUGH = 0.08
_MIN_TILT_DEG = 10.0
_MAX_FOCAL_STD = 0.01
# The bend of a board counts if it is certain (chi2, 3 degrees of freedom) and not negligible.
_BEND_CHI2 = 30.0
_BEND_SHARE = 5e-4
_BEND_MIN_VIEWS = 10
_STRETCH = 5e-4
_COVERAGE_GRID = 8
# Indices of p1, p2 and of k3, and the chi2 below which they are noise (3 sigma).
_OPTIONAL = ((6, 7), (8,))
_CHI2 = {1: 9.0, 2: 11.8}


@dataclass(frozen=True, eq=False, kw_only=True)
class CameraCalibration:
    """
    A camera and how well the pictures determine it.

    rms, view_rms : pixel; view_rms in the order of ``used``
    std : 1 sigma of each intrinsic parameter, cluster-robust
    coverage : share of the cells of an 8 x 8 grid over the picture that hold a corner
    dropped : name of each picture that was not used, and why
    warnings : what a user should know, one line each
    """

    camera: Camera
    board: Board
    bend: Bend
    used: tuple[View, ...]
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
    views: Views,
    model: str = 'plumb_bob',
    *,
    bend: bool = True,
    square: bool = True,
    where: str = 'pictures',
) -> CameraCalibration:
    """
    Calibrate a camera.

    model : plumb_bob or rational_polynomial
    bend : whether a board that is not flat may be taken for bent
    square : whether pixels are square; what the pictures show of fx / fy is then the print's
    where : folder of the pictures, for messages
    :raises CalibrationError: too few or too similar views
    """
    require_one_of('model', model, DISTORTION_COEFFICIENTS, error=CalibrationError)
    free = Free(square=square, stretch=square, bend=bend)
    used, bundle = _without_bad(board, views, model, free, where)
    bundle = _simplest(board, [view.corners for view in used], bundle, free)
    _require_determined(bundle, where)
    camera = _camera(bundle, views.size, model, where)
    std = np.sqrt(np.diag(bundle.covariance)[: len(bundle.intrinsics)])
    kept = {view.path for view in used}
    dropped = {name_of(path): 'the board was not found' for path in views.without}
    dropped |= {v.name: 'large residuals' for v in views.found if v.path not in kept}
    cells = _covered(used, views.size, _COVERAGE_GRID)
    return CameraCalibration(
        camera=camera,
        board=board,
        bend=bundle.bend,
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


def _without_bad(
    board: Board, views: Views, model: str, free: Free, where: str
) -> tuple[list[View], Bundle]:
    """Adjust, drop the views that stand out, and again until none does."""
    used = list(views.found)
    _require_enough(used, where)
    bundle = _initial(board, views, model, free.square, where)
    while True:
        corners = [view.corners for view in used]
        bundle = adjust_with_bend(board, corners, bundle, free)
        good = good_views(bundle.view_rms)
        if good.all():
            return used, bundle
        used = [view for view, is_good in zip(used, good, strict=True) if is_good]
        _require_enough(used, where)
        bundle = replace(bundle, poses=bundle.poses[good], residuals=())


def _simplest(board: Board, corners: Sequence[Corners], bundle: Bundle, free: Free) -> Bundle:
    """
    Set distortion coefficients to zero that the pictures do not ask for (Wald tests).

    A tangential distortion of nothing but noise moves the principal point by a pixel.
    """
    held: tuple[int, ...] = ()
    for group in _OPTIONAL:
        index = list(group)
        values, covariance = bundle.intrinsics[index], bundle.covariance[np.ix_(index, index)]
        if values @ np.linalg.lstsq(covariance, values, rcond=None)[0] < _CHI2[len(index)]:
            held += group
            intrinsics = bundle.intrinsics.copy()
            intrinsics[index] = 0.0
            start = replace(bundle, intrinsics=intrinsics)
            bundle = adjust_with_bend(board, corners, start, replace(free, held=held))
    return bundle


def good_views(view_rms: Floats) -> Bools:
    """Tell which views do not stand out, (views,) bool."""
    return np.asarray(view_rms <= max(_BAD_VIEW * float(np.median(view_rms)), _GOOD_ENOUGH))


def adjust_with_bend(
    board: Board, corners: Sequence[Corners], start: Bundle, free: Free
) -> Bundle:
    """
    Adjust with a flat board; if ``free`` allows it and the pictures show it, with a bent one.

    A bend must be certain (Wald test with the cluster-robust covariance) and more than 0.05 % of
    the board's diagonal.
    """
    start = replace(start, bend=Bend.flat(board), residuals=())
    enough = len(corners) >= _BEND_MIN_VIEWS
    flat = adjust(board, corners, start, replace(free, bend=False))
    if not (free.bend and enough):
        return flat
    bent = adjust(board, corners, flat, free)
    return bent if _is_bent(board, bent) else flat


def _is_bent(board: Board, bent: Bundle) -> bool:
    c = bent.bend.coefficients[:3]
    chi2 = c @ np.linalg.lstsq(bent.covariance[-4:-1, -4:-1], c, rcond=None)[0]
    diagonal = np.linalg.norm(np.ptp(board.corners_xyz, axis=0))
    return bool(chi2 > _BEND_CHI2 and bent.bend.sag(board) > _BEND_SHARE * diagonal)


def _initial(board: Board, views: Views, model: str, square: bool, where: str) -> Bundle:
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
    return Bundle(
        intrinsics=np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *coefficients]),
        bend=Bend.flat(board),
        poses=np.asarray(poses, dtype=np.float64),
        covariance=np.zeros((0, 0)),
        residuals=(),
    )


def _require_enough(used: Sequence[View], where: str) -> None:
    if len(used) < MIN_VIEWS:
        raise CalibrationError(
            f'{where}: {len(used)} good pictures of the board, {MIN_VIEWS} is least; '
            'take 20 or more with the board tilted in different ways'
        )


def _require_determined(bundle: Bundle, where: str) -> None:
    normals = np.array([cv2.Rodrigues(pose[:3])[0][:, 2] for pose in bundle.poses])
    cosines = np.clip(normals @ normals.T, -1, 1)
    tilt = np.degrees(np.arccos(cosines.min()))
    focal_std = np.sqrt(np.diag(bundle.covariance)[:2]) / bundle.intrinsics[:2]
    if tilt < _MIN_TILT_DEG or not focal_std.max() < _MAX_FOCAL_STD:
        raise _too_similar(where)


def _too_similar(where: str) -> CalibrationError:
    return CalibrationError(
        f'{where}: the views of the board are too parallel to tell the focal length from the '
        'distance; tilt the board by 30 degrees or more, in different directions'
    )


def _camera(bundle: Bundle, size: tuple[int, int], model: str, where: str) -> Camera:
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
            f'{where}: the pictures give no possible camera: {error}'
        ) from error


def _covered(used: Sequence[View], size: tuple[int, int], grid: int) -> Bools:
    uv = np.concatenate([view.corners.uv for view in used])
    edges = [np.linspace(-0.5, length - 0.5, grid + 1) for length in (size[1], size[0])]
    return np.asarray(np.histogram2d(uv[:, 1], uv[:, 0], bins=edges)[0] > 0)


def _warnings(
    board: Board, bundle: Bundle, used: Sequence[View], size: tuple[int, int]
) -> list[str]:
    warnings = []
    corner = _covered(used, size, 4)
    places = {'upper left': (0, 0), 'upper right': (0, 3), 'lower left': (3, 0)}
    places['lower right'] = (3, 3)
    empty = [name for name, cell in places.items() if not corner[cell]]
    if empty:
        warnings.append(
            f'no picture has the board in the {", ".join(empty)} of the image; '
            'the distortion there is extrapolated'
        )
    if not bundle.bend.is_flat:
        warnings.append(
            f'the board is not flat but bent by {bundle.bend.sag(board) * 1e3:.2f} mm; '
            'this was taken into account, a flat board is better'
        )
    if abs(bundle.bend.stretch) > _STRETCH:
        warnings.append(
            f'the squares are {bundle.bend.stretch * 100:+.2f} % longer along the columns than '
            'along the rows, or the pixels are not square (then use --no-square-pixels); '
            'measure the board both ways'
        )
    return warnings
