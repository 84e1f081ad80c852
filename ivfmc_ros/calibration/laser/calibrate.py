# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Laser plane from pictures of a calibration board with the laser stripe on it."""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import field
from pathlib import Path

import numpy as np

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board_shape import BoardShape
from ivfmc_ros.calibration.boards.views import BoardView
from ivfmc_ros.calibration.boards.views import BoardViews
from ivfmc_ros.calibration.boards.views import for_each_picture
from ivfmc_ros.calibration.boards.views import picture_name
from ivfmc_ros.calibration.boards.views import read_sized
from ivfmc_ros.calibration.camera.board_poses import BoardPose
from ivfmc_ros.calibration.camera.board_poses import estimate_board_poses
from ivfmc_ros.calibration.laser import plane as planes
from ivfmc_ros.calibration.laser.paper_mask import paper_mask
from ivfmc_ros.calibration.laser.plane import PlaneFit
from ivfmc_ros.calibration.laser.plane import StripePoints
from ivfmc_ros.calibration.laser.stripes import BoardStripe
from ivfmc_ros.calibration.laser.stripes import extract_board_stripe
from ivfmc_ros.calibration.laser.stripes import white_mask
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.cell.laser import Stripe as Direction
from ivfmc_ros.errors import CalibrationError
from ivfmc_ros.errors import CellError
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.progress import no_progress
from ivfmc_ros.progress import Progress
from ivfmc_ros.stripe.extract import ExtractSettings

MIN_VIEWS = 5
# Least ratio of the two greatest singular values of all stripe points: a single line in space
# leaves the plane open.
_MIN_SPREAD = 0.05
# A bow is stored if it is significant (Wald test, chi2 with 3 degrees of freedom: p < 2e-6) and
# explains this fraction of the residuals' variance: extrapolated, it grows with the square.
_BOW_CHI2 = 30.0
_MIN_BOW_GAIN = 0.3
_BOW_MIN_VIEWS = 10
_PIXEL_VARIANCE = 1.0 / 12.0  # pixel^2, of a uniform distribution over a pixel
_STEP_PIXEL = 0.25  # pixels, for the numerical Jacobian
_STEP_POSE = 1e-6  # radians and meters, for the numerical Jacobian


@dataclass(frozen=True, kw_only=True)
class LaserSettings:
    """
    Settings of a laser calibration.

    name : of the laser in ``cell.yaml``
    stripe : one stripe point per image row ('rows') or column ('columns')
    fit_bend : whether the bend of the board is estimated, if it is significant
    fit_bow : whether the bow of the laser plane is estimated, if it is significant
    extract : stripe extraction
    """

    name: str = 'laser'
    stripe: Direction = 'rows'
    fit_bend: bool = True
    fit_bow: bool = True
    extract: ExtractSettings = field(default_factory=ExtractSettings)


@dataclass(frozen=True, eq=False, kw_only=True)
class LaserView:
    """
    One picture: pose of the board, the stripe on it, residuals and inliers of the plane.

    residuals : (n,) meters, distances of the points from the plane
    inlier_mask : (n,) bool, points used by the fit
    """

    view: BoardView
    board_pose: BoardPose
    stripe: BoardStripe
    points: StripePoints
    residuals: Floats
    inlier_mask: Bools


@dataclass(frozen=True, eq=False, kw_only=True)
class LaserCalibration:
    """
    Result of a laser calibration.

    laser : ``residual_rms`` in meters is that of the inliers
    used : views of the fit
    dropped : reason by name of each picture that was not used
    inlier_fraction : inliers over all stripe points of views with a stripe
    plane_std : meters, 1 sigma of the plane at the least certain of its points
    bow_height : meters, greatest deviation of the estimated bow from the plane at the points,
        whether the bow is stored or not
    warnings : one line each, for the operator
    """

    laser: LaserPlane
    board: Board
    board_shape: BoardShape
    used: tuple[LaserView, ...]
    dropped: dict[str, str]
    inlier_fraction: float
    plane_std: float
    bow_height: float
    warnings: tuple[str, ...]


def calibrate_laser(
    camera: Camera,
    board: Board,
    views: BoardViews,
    settings: LaserSettings | None = None,
    *,
    extra: Sequence[StripePoints] = (),
    where: str = 'pictures',
    progress: Progress = no_progress,
) -> LaserCalibration:
    """
    Estimate the plane of a laser, and its bow if it is significant.

    views : detections of ``board``, from ``find_views``
    extra : stripe points on other known surfaces, such as the platter
    where : folder of the pictures, for messages
    :raises CalibrationError: too few stripes, or stripes along one line in space
    """
    settings = settings or LaserSettings()
    dropped = {picture_name(path): 'board not detected' for path in views.missed}
    corners = [view.corners for view in views.found]
    board_poses, good = estimate_board_poses(board, corners, camera, settings.fit_bend)
    dropped |= _reasons(views.found, ~good, 'large residuals of the board corners')
    posed = [(v, p) for v, p, g in zip(views.found, board_poses, good, strict=True) if g]
    stripes = _extract_stripes(camera, board, posed, settings, progress)
    lacking = np.array([stripe is None for stripe in stripes], dtype=bool)
    dropped |= _reasons([v for v, _ in posed], lacking, 'no stripe detected on the board')
    found = [(v, p, s) for (v, p), s in zip(posed, stripes, strict=True) if s is not None]
    _require_enough(len(found), where)
    points = [triangulate_stripe(camera, p, s, settings.stripe) for _, p, s in found]
    keep, plane = planes.find_inliers(points, planes.least_median_plane(points))
    enough = np.array([k.mean() >= 0.5 for k in keep])
    dropped |= _reasons([v for v, _, _ in found], ~enough, 'stripe not on the common plane')
    _require_enough(int(enough.sum()), where)
    chosen = [p.select(k) for p, k, e in zip(points, keep, enough, strict=True) if e]
    _require_spread(chosen, where)
    chosen += extra
    fit, bow_height = _fit_plane(chosen, plane, settings)
    used = tuple(
        _laser_view(*parts, x, k, fit)
        for parts, x, k, e in zip(found, points, keep, enough, strict=True)
        if e
    )
    laser = _laser(fit, chosen, sheet_thickness(used, fit.normal), settings, where)
    shape = board_poses[0].board_shape
    return LaserCalibration(
        laser=laser,
        board=board,
        board_shape=shape,
        used=used,
        dropped=dropped,
        inlier_fraction=sum(map(len, chosen)) / sum(map(len, points)),
        plane_std=plane_std(fit, chosen),
        bow_height=bow_height,
        warnings=tuple(_warnings(board, shape, laser, bow_height)),
    )


def _laser_view(
    view: BoardView,
    board_pose: BoardPose,
    stripe: BoardStripe,
    points: StripePoints,
    inlier_mask: Bools,
    fit: PlaneFit,
) -> LaserView:
    return LaserView(
        view=view,
        board_pose=board_pose,
        stripe=stripe,
        points=points,
        residuals=fit.distance(points.points_xyz),
        inlier_mask=inlier_mask,
    )


def _extract_stripes(
    camera: Camera,
    board: Board,
    posed: Sequence[tuple[BoardView, BoardPose]],
    settings: LaserSettings,
    progress: Progress,
) -> list[BoardStripe | None]:
    rays = pixel_rays(camera)
    views_by_path = {view.path: (view, board_pose) for view, board_pose in posed}

    def extract_stripe(path: Path) -> BoardStripe | None:
        view, board_pose = views_by_path[path]
        image = read_sized(path, camera.size)
        mask = paper_mask(board, board_pose, view.corners, camera, image)
        white = white_mask(board, board_pose, mask, rays)
        return extract_board_stripe(image, white, camera, settings.stripe, settings.extract)

    return for_each_picture(extract_stripe, list(views_by_path), 'stripe', progress)


def pixel_rays(camera: Camera) -> Floats:
    """Return the (height, width, 3) rays of unit depth of all pixels."""
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    uv = np.stack([columns.ravel(), rows.ravel()], axis=1)
    return camera.rays(uv).reshape(camera.height, camera.width, 3)


def triangulate_stripe(
    camera: Camera, board_pose: BoardPose, stripe: BoardStripe, direction: Direction
) -> StripePoints:
    """Intersect the rays of a stripe with the board; return the points with their Jacobians."""
    rays = camera.rays(stripe.uv)
    points = board_pose.intersect(rays)
    step = np.array([_STEP_PIXEL, 0.0] if direction == 'rows' else [0.0, _STEP_PIXEL])
    moved = board_pose.intersect(camera.rays(stripe.uv + step))
    pose_jacobian = [
        (board_pose.intersect(rays, board_pose.pose + _STEP_POSE * unit) - points) / _STEP_POSE
        for unit in np.eye(6)
    ]
    return StripePoints(
        points_xyz=points,
        pixel_jacobian=(moved - points) / _STEP_PIXEL,
        pose_jacobian=np.stack(pose_jacobian, axis=2),
        sigma=stripe.sigma,
        pose_covariance=board_pose.covariance,
    )


def _fit_plane(
    chosen: Sequence[StripePoints], plane: Floats, settings: LaserSettings
) -> tuple[PlaneFit, float]:
    """Fit a plane, or a bowed one if the bow is significant; return also the bow in meters."""
    flat = planes.fit_plane(chosen, plane)
    if not settings.fit_bow or len(chosen) < _BOW_MIN_VIEWS:
        return flat, 0.0
    bowed = planes.fit_plane(chosen, plane, bowed=True)
    if bowed.bow is None:
        raise AssertionError('fit_plane(bowed=True) returned no bow')
    points = np.concatenate([view.points_xyz for view in chosen])
    basis = planes.bow_basis(bowed.bow, bowed.normal, points)
    off_plane = basis @ bowed.bow.coefficients
    linear = np.column_stack([points @ bowed.bow.along, points, np.ones(len(points))])
    off_plane = off_plane - linear @ np.linalg.lstsq(linear, off_plane, rcond=None)[0]
    height = float(np.abs(off_plane).max())
    c = bowed.bow.coefficients
    chi2 = c @ np.linalg.solve(bowed.covariance[4:, 4:], c)
    before, after = (np.mean(fit.distance(points) ** 2) for fit in (flat, bowed))
    is_bowed = chi2 > _BOW_CHI2 and after < (1 - _MIN_BOW_GAIN) * before
    return (bowed if is_bowed else flat), height


def plane_std(fit: PlaneFit, views: Sequence[StripePoints]) -> float:
    """Return 1 sigma in meters of the distance from the plane at its least certain point."""
    points = np.concatenate([view.points_xyz for view in views])
    design = np.column_stack([points, np.ones(len(points))])
    return float(np.sqrt(np.einsum('ni,ij,nj->n', design, fit.covariance[:4, :4], design).max()))


def sheet_thickness(views: Sequence[LaserView], normal: Floats) -> float:
    """
    Return the thickness of the light sheet, 1 sigma in meters: the median over views.

    The width of the stripe in the picture is projected on the normal of the plane. The variance
    of a pixel's own extent is subtracted. The blur of the lens is unknown and counts as thickness:
    2 % too much for a stripe of 2.5 pixels (1 sigma) and a blur of 0.5 pixels.
    """
    found = []
    for view in views:
        across = np.abs(view.points.pixel_jacobian[view.inlier_mask] @ normal)
        square = view.stripe.width[view.inlier_mask] ** 2 - _PIXEL_VARIANCE
        found.append(np.median(across * np.sqrt(np.maximum(square, 0.0))))
    return float(np.median(found))


def _laser(
    fit: PlaneFit,
    chosen: Sequence[StripePoints],
    thickness: float,
    settings: LaserSettings,
    where: str,
) -> LaserPlane:
    points = np.concatenate([view.points_xyz for view in chosen])
    try:
        return LaserPlane(
            name=settings.name,
            normal=fit.normal,
            offset=fit.offset,
            stripe=settings.stripe,
            residual_rms=float(np.sqrt(np.mean(fit.distance(points) ** 2))),
            bow=fit.bow,
            covariance=fit.covariance[:4, :4],
            volume=np.array([points.min(axis=0), points.max(axis=0)]),
            thickness=thickness,
        )
    except CellError as error:
        raise CalibrationError(f'{where}: {error}') from error


def _reasons(views: Sequence[BoardView], chosen: Bools, reason: str) -> dict[str, str]:
    return {view.name: reason for view, is_chosen in zip(views, chosen, strict=True) if is_chosen}


def _require_enough(count: int, where: str) -> None:
    if count < MIN_VIEWS:
        raise CalibrationError(
            f'{where}: {count} usable pictures with the stripe on the board, at least '
            f'{MIN_VIEWS} are needed; take 20 or more, with the stripe across white parts of the '
            'board'
        )


def _require_spread(chosen: Sequence[StripePoints], where: str) -> None:
    points = np.concatenate([view.points_xyz for view in chosen])
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if spread[1] < _MIN_SPREAD * spread[0]:
        raise CalibrationError(
            f'{where}: the stripes lie nearly on one line in space, which does not determine a '
            'plane; move the board towards the camera and away from it, and tilt it'
        )


def _warnings(board: Board, shape: BoardShape, laser: LaserPlane, bow_height: float) -> list[str]:
    warnings = []
    if not shape.is_flat:
        warnings.append(
            f'the board is bent by {shape.sag(board) * 1e3:.2f} mm; '
            'the calibration accounts for it, but a flat board is more accurate'
        )
    if laser.bow is not None:
        warnings.append(
            f'the laser plane is bowed by {bow_height * 1e3:.2f} mm; the bow is stored'
        )
    return warnings
