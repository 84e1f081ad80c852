# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The laser's plane from pictures of a board with the stripe on it."""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import field
from pathlib import Path

import numpy as np

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.views import for_each_picture
from ivfmc_ros.calibration.boards.views import name_of
from ivfmc_ros.calibration.boards.views import read_sized
from ivfmc_ros.calibration.boards.views import View
from ivfmc_ros.calibration.boards.views import Views
from ivfmc_ros.calibration.camera.board_poses import place_boards
from ivfmc_ros.calibration.camera.board_poses import Placed
from ivfmc_ros.calibration.camera.bow import Bend
from ivfmc_ros.calibration.laser import plane as planes
from ivfmc_ros.calibration.laser.paper_mask import paper_of
from ivfmc_ros.calibration.laser.plane import Sheet
from ivfmc_ros.calibration.laser.plane import StripePoints
from ivfmc_ros.calibration.laser.stripes import BoardStripe
from ivfmc_ros.calibration.laser.stripes import stripe_on_board
from ivfmc_ros.calibration.laser.stripes import white_region
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.cell.laser import Stripe as Direction
from ivfmc_ros.errors import CalibrationError
from ivfmc_ros.errors import CellError
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.progress import Progress
from ivfmc_ros.progress import silent
from ivfmc_ros.stripe.extract import ExtractSettings

MIN_VIEWS = 5
# Stripes must spread over the plane in two directions, the lesser at least this share.
_MIN_SPREAD = 0.05
# A bow counts if it is certain (chi2, 3 degrees of freedom) and explains this share of the
# residuals' variance: outside the calibrated distances it grows with their square.
_BOW_CHI2 = 30.0
_BOW_SHARE = 0.3
_BOW_MIN_VIEWS = 10
_PIXEL = 1.0 / 12.0  # variance of where light comes from within a pixel
_STEP_PIXEL = 0.25
_STEP_POSE = 1e-6


@dataclass(frozen=True, kw_only=True)
class LaserSettings:
    """
    How a laser is calibrated.

    name : in ``cell.yaml``
    stripe : rows or columns
    bend : whether a board that is not flat may be taken for bent
    bow : whether a sheet that is not plane may be taken for bowed
    """

    name: str = 'laser'
    stripe: Direction = 'rows'
    bend: bool = True
    bow: bool = True
    extract: ExtractSettings = field(default_factory=ExtractSettings)


@dataclass(frozen=True, eq=False, kw_only=True)
class LaserView:
    """One picture: where the board was, the stripe on it, and which points were kept."""

    view: View
    placed: Placed
    stripe: BoardStripe
    points: StripePoints
    residuals: Floats
    kept: Bools


@dataclass(frozen=True, eq=False, kw_only=True)
class LaserCalibration:
    """
    A laser and how well the pictures determine it.

    laser : its residual_rms is that of the kept points, metres
    kept_share : share of the stripe points of all views with a stripe that were kept
    plane_error : metres, 1 sigma of the plane at the worst of its own points
    bow_height : metres, the most that the sheet departs from its plane at its points; the
        measured one, whether it was stored or not
    """

    laser: LaserPlane
    board: Board
    bend: Bend
    used: tuple[LaserView, ...]
    dropped: dict[str, str]
    kept_share: float
    plane_error: float
    bow_height: float
    warnings: tuple[str, ...]


def calibrate_laser(
    camera: Camera,
    board: Board,
    views: Views,
    settings: LaserSettings | None = None,
    *,
    extra: Sequence[StripePoints] = (),
    where: str = 'pictures',
    progress: Progress = silent,
) -> LaserCalibration:
    """
    Calibrate a laser.

    views : from ``find_views``
    extra : other stripes on known surfaces, such as the platter
    where : folder of the pictures, for messages
    :raises CalibrationError: too few stripes, or too similar ones
    """
    settings = settings or LaserSettings()
    dropped = {name_of(path): 'the board was not found' for path in views.without}
    placed, good = place_boards(board, [v.corners for v in views.found], camera, settings.bend)
    dropped |= _names(views.found, ~good, 'large residuals of the board')
    seen = [(v, p) for v, p, g in zip(views.found, placed, good, strict=True) if g]
    stripes = _find_stripes(camera, board, seen, settings, progress)
    dropped |= {
        v.name: 'no stripe on the board' for (v, _), s in zip(seen, stripes, strict=True) if not s
    }
    found = [(v, p, s) for (v, p), s in zip(seen, stripes, strict=True) if s is not None]
    _require_enough(len(found), where)
    points = [in_space(camera, p, s, settings.stripe) for _, p, s in found]
    keep, plane = planes.inliers(points, planes.agreeing_plane(points))
    enough = np.array([k.mean() >= 0.5 for k in keep])
    dropped |= _names([v for v, _, _ in found], ~enough, 'stripe off the plane')
    _require_enough(int(enough.sum()), where)
    chosen = [p.chosen(k) for p, k, e in zip(points, keep, enough, strict=True) if e]
    _require_spread(chosen, where)
    chosen += extra
    sheet, bow_height = _fit(chosen, plane, settings)
    used = tuple(
        LaserView(
            view=v, placed=p, stripe=s, points=x, residuals=sheet.distance(x.points_xyz), kept=k
        )
        for (v, p, s), x, k, e in zip(found, points, keep, enough, strict=True)
        if e
    )
    laser = _laser(sheet, chosen, sheet_thickness(used, sheet.normal), settings, where)
    bend = placed[0].bend
    return LaserCalibration(
        laser=laser,
        board=board,
        bend=bend,
        used=used,
        dropped=dropped,
        kept_share=sum(map(len, chosen)) / sum(map(len, points)),
        plane_error=plane_error(sheet, chosen),
        bow_height=bow_height,
        warnings=tuple(_warnings(board, bend, laser, bow_height)),
    )


def _find_stripes(
    camera: Camera,
    board: Board,
    seen: Sequence[tuple[View, Placed]],
    settings: LaserSettings,
    progress: Progress,
) -> list[BoardStripe | None]:
    rays = pixel_rays(camera)
    places = {view.path: (view, placed) for view, placed in seen}

    def look(path: Path) -> BoardStripe | None:
        view, placed = places[path]
        image = read_sized(path, camera.size)
        paper = paper_of(board, placed, view.corners, camera, image)
        white = white_region(board, placed, paper, rays)
        return stripe_on_board(image, white, camera, settings.stripe, settings.extract)

    return for_each_picture(look, list(places), 'stripe', progress)


def pixel_rays(camera: Camera) -> Floats:
    """Return the (height, width, 3) rays of all pixels."""
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    uv = np.stack([columns.ravel(), rows.ravel()], axis=1)
    return camera.rays(uv).reshape(camera.height, camera.width, 3)


def in_space(
    camera: Camera, placed: Placed, stripe: BoardStripe, direction: Direction
) -> StripePoints:
    """Intersect the rays of a stripe with its board, and say how uncertain the points are."""
    rays = camera.rays(stripe.uv)
    points = placed.intersect(rays)
    step = np.array([_STEP_PIXEL, 0.0] if direction == 'rows' else [0.0, _STEP_PIXEL])
    moved = placed.intersect(camera.rays(stripe.uv + step))
    by_pose = [
        (placed.intersect(rays, placed.pose + _STEP_POSE * unit) - points) / _STEP_POSE
        for unit in np.eye(6)
    ]
    return StripePoints(
        points_xyz=points,
        by_pixel=(moved - points) / _STEP_PIXEL,
        by_pose=np.stack(by_pose, axis=2),
        sigma=stripe.sigma,
        pose_covariance=placed.covariance,
    )


def _fit(
    chosen: Sequence[StripePoints], plane: Floats, settings: LaserSettings
) -> tuple[Sheet, float]:
    """Fit a plane; a bowed sheet if the data ask for it. Returns the bow's height as well."""
    flat = planes.fit_sheet(chosen, plane)
    if not settings.bow or len(chosen) < _BOW_MIN_VIEWS:
        return flat, 0.0
    bowed = planes.fit_sheet(chosen, plane, bowed=True)
    if bowed.bow is None:
        raise AssertionError('fit_sheet left out the bow')
    points = np.concatenate([view.points_xyz for view in chosen])
    basis = planes.bow_basis(bowed.bow, bowed.normal, points)
    off_plane = basis @ bowed.bow.coefficients
    linear = np.column_stack([points @ bowed.bow.along, points, np.ones(len(points))])
    off_plane = off_plane - linear @ np.linalg.lstsq(linear, off_plane, rcond=None)[0]
    height = float(np.abs(off_plane).max())
    c = bowed.bow.coefficients
    chi2 = c @ np.linalg.solve(bowed.covariance[4:, 4:], c)
    before, after = (np.mean(sheet.distance(points) ** 2) for sheet in (flat, bowed))
    is_bowed = chi2 > _BOW_CHI2 and after < (1 - _BOW_SHARE) * before
    return (bowed if is_bowed else flat), height


def plane_error(sheet: Sheet, views: Sequence[StripePoints]) -> float:
    """Return 1 sigma in metres of the plane's place at the worst of its points."""
    points = np.concatenate([view.points_xyz for view in views])
    design = np.column_stack([points, np.ones(len(points))])
    return float(np.sqrt(np.einsum('ni,ij,nj->n', design, sheet.covariance[:4, :4], design).max()))


def sheet_thickness(views: Sequence[LaserView], normal: Floats) -> float:
    """
    Return 1 sigma of the sheet in metres: the median over views of how wide the stripe is.

    The width in the picture is that on the board, seen along the normal of the sheet. A pixel sees
    the mean over itself, which is taken off; blur of the lens is not known and counts as
    thickness: 2 % too much for a stripe of 2.5 pixels (1 sigma) and a blur of 0.5.
    """
    found = []
    for view in views:
        across = np.abs(view.points.by_pixel[view.kept] @ normal)
        square = view.stripe.width[view.kept] ** 2 - _PIXEL
        found.append(np.median(across * np.sqrt(np.maximum(square, 0.0))))
    return float(np.median(found))


def _laser(
    sheet: Sheet,
    chosen: Sequence[StripePoints],
    thickness: float,
    settings: LaserSettings,
    where: str,
) -> LaserPlane:
    points = np.concatenate([view.points_xyz for view in chosen])
    try:
        return LaserPlane(
            name=settings.name,
            normal=sheet.normal,
            offset=sheet.offset,
            stripe=settings.stripe,
            residual_rms=float(np.sqrt(np.mean(sheet.distance(points) ** 2))),
            bow=sheet.bow,
            covariance=sheet.covariance[:4, :4],
            volume=np.array([points.min(axis=0), points.max(axis=0)]),
            thickness=thickness,
        )
    except CellError as error:
        raise CalibrationError(f'{where}: {error}') from error


def _names(views: Sequence[View], chosen: Bools, reason: str) -> dict[str, str]:
    return {view.name: reason for view, is_chosen in zip(views, chosen, strict=True) if is_chosen}


def _require_enough(count: int, where: str) -> None:
    if count < MIN_VIEWS:
        raise CalibrationError(
            f'{where}: {count} usable pictures with the stripe on the board, {MIN_VIEWS} is '
            'least; take 20 or more, with the stripe across white parts of the board'
        )


def _require_spread(chosen: Sequence[StripePoints], where: str) -> None:
    points = np.concatenate([view.points_xyz for view in chosen])
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if spread[1] < _MIN_SPREAD * spread[0]:
        raise CalibrationError(
            f'{where}: the stripes lie nearly on one line in space, which many planes hold; '
            'move the board towards the camera and away from it, and tilt it'
        )


def _warnings(board: Board, bend: Bend, laser: LaserPlane, bow_height: float) -> list[str]:
    warnings = []
    if not bend.is_flat:
        warnings.append(
            f'the board is not flat but bent by {bend.sag(board) * 1e3:.2f} mm; '
            'this was taken into account, a flat board is better'
        )
    if laser.bow is not None:
        warnings.append(
            f"the laser's sheet is not plane but bowed by {bow_height * 1e3:.2f} mm; "
            'the bow is stored'
        )
    return warnings
