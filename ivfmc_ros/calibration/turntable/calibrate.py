# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Turntable axis, platter plane and table angles from pictures of a board or markers on it."""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace

import numpy as np

from ivfmc_ros.calibration.boards.markers import Markers
from ivfmc_ros.calibration.turntable.axis import AxisState
from ivfmc_ros.calibration.turntable.axis import CornerObservations
from ivfmc_ros.calibration.turntable.axis import PlatterPoints
from ivfmc_ros.calibration.turntable.axis_adjustment import adjust_axis
from ivfmc_ros.calibration.turntable.axis_adjustment import AxisAdjustment
from ivfmc_ros.calibration.turntable.axis_adjustment import correlation_inflation
from ivfmc_ros.calibration.turntable.axis_adjustment import FreeAxisParameters
from ivfmc_ros.calibration.turntable.axis_initialization import initialize_axis
from ivfmc_ros.calibration.turntable.observations import focal_lengths
from ivfmc_ros.calibration.turntable.observations import PlatterViews
from ivfmc_ros.calibration.turntable.observations import Target
from ivfmc_ros.calibration.turntable.platter_stripes import PlatterStripes
from ivfmc_ros.calibration.turntable.scale import measured_ratio
from ivfmc_ros.calibration.turntable.scale import ScaleCheck
from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.cell import Turntable
from ivfmc_ros.errors import CalibrationError
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats

MIN_PICTURES = 5
# Least range of table angles: a shorter arc leaves the axis uncertain.
MIN_TURN = np.radians(60.0)
_MAX_AXIS_STD = 1e-3  # meters, of the position of the axis
# Sigmas: a corner with a greater residual is an outlier, disturbed by the stripe or hidden.
_OUTLIER = 4.5


@dataclass(frozen=True, eq=False, kw_only=True)
class TurntableCalibration:
    """
    Result of a turntable calibration.

    views : detections; ``adjusted.residuals`` are those of the inliers
    inlier_mask : (n,) bool, of ``views.observations``
    scale_source : 'laser' if stripes on the platter gave the scale, else 'markers' or 'board'
    scale : measured over nominal length of board or markers; 1 where it gives the scale
    scale_check : of that length by the laser; None without stripes
    platter_rms : meters, of the stripe points about the platter's plane; None without stripes
    wobble, wobble_std : radians between the platter's normal and the axis, and its 1 sigma
    """

    turntable: Turntable
    views: PlatterViews
    adjusted: AxisAdjustment
    inlier_mask: Bools
    stripes: PlatterStripes | None
    scale_source: str
    scale: float
    scale_check: ScaleCheck | None
    platter_rms: float | None
    wobble: float
    wobble_std: float

    @property
    def angles(self) -> dict[str, float]:
        """Angle in radians of each picture, by name; continuous, the first picture is 0."""
        unwrapped = np.unwrap(self.adjusted.axis.angles)
        names = [path.name for path in self.views.pictures]
        return dict(zip(names, unwrapped.tolist(), strict=True))

    @property
    def turns_positive(self) -> bool:
        """Whether the table turns counter-clockwise, seen from above, from picture to picture."""
        return bool(np.median(np.diff(list(self.angles.values()))) > 0)


def estimate_axis(camera: Camera, views: PlatterViews, where: str) -> tuple[AxisAdjustment, Bools]:
    """
    Estimate the axis from the nominal lengths of board or markers.

    where : folder of the pictures, for messages
    returns : the result, and (n,) bool: the inliers among the observations
    :raises CalibrationError: the pictures do not determine an axis
    """
    _require_pictures(views, where)
    focal = focal_lengths(camera)
    start = initialize_axis(views.observations, focal, where)
    _require_turn(start, where)
    return _adjust(
        camera, views, start, free_parameters(views.target, None), PlatterPoints.empty()
    )


def free_parameters(target: Target, stripes: PlatterStripes | None) -> FreeAxisParameters:
    """Return the parameters to estimate; with stripes, the scale is one of them."""
    if isinstance(target, Markers):
        return FreeAxisParameters(side=None if stripes else target.side, scale=False)
    return FreeAxisParameters(scale=stripes is not None)


def calibrate_turntable(
    camera: Camera,
    views: PlatterViews,
    first: AxisAdjustment,
    stripes: PlatterStripes | None = None,
    *,
    thickness: float = 0.0,
    where: str = 'pictures',
) -> TurntableCalibration:
    """
    Estimate the pose of the turntable, with the scale of the laser if there are stripes.

    first : from ``estimate_axis``
    stripes : stripe points on the bare platter; they give the platter's height and the scale
    thickness : meters, of the board on the platter; not used with stripes
    where : folder of the pictures, for messages
    :raises CalibrationError: the standard deviation of the axis is more than 1 mm
    """
    platter_points = stripes.platter_points if stripes else PlatterPoints.empty()
    free = free_parameters(views.target, stripes)
    adjusted, kept = _adjust(camera, views, first.axis, free, platter_points)
    axis = x_towards_camera(adjusted.axis)
    adjusted = replace(adjusted, axis=axis)
    if np.sqrt(np.diag(adjusted.covariance)[2:4].max()) > _MAX_AXIS_STD:
        raise CalibrationError(
            f'{where}: the axis is uncertain by more than {_MAX_AXIS_STD * 1e3:g} mm (1 sigma); '
            'take pictures at more angles all around, nearer, or with larger markers'
        )
    residual = np.linalg.norm(adjusted.residuals, axis=1)
    depth = axis.corners_in_camera(views.observations)[kept][:, 2]
    lengths = residual * depth / focal_lengths(camera).mean()
    rms = None
    if stripes:
        rms = float(np.sqrt(np.mean(axis.heights(stripes.platter_points.points_xyz) ** 2)))
    base = axis.camera_from_base @ transforms.rigid(np.eye(3), (0.0, 0.0, -thickness))
    if stripes:
        base = axis.camera_from_base
    wobble, wobble_std = _wobble(adjusted)
    return TurntableCalibration(
        turntable=Turntable(
            camera_from_base=base,
            residual_rms=float(np.sqrt(np.mean(lengths**2))),
            covariance=_pose_covariance(adjusted),
        ),
        views=views,
        adjusted=adjusted,
        inlier_mask=kept,
        stripes=stripes,
        scale_source=_scale_source(views.target, stripes),
        scale=measured_ratio(views.target, axis),
        scale_check=_scale_check(views.target, adjusted) if stripes else None,
        platter_rms=rms,
        wobble=wobble,
        wobble_std=wobble_std,
    )


def measure_angles(
    camera: Camera, turntable: Turntable, views: PlatterViews, where: str = 'pictures'
) -> AxisAdjustment:
    """
    Measure the table angle of pictures taken in a calibrated cell.

    returns : ``axis.angles`` in radians, 0 for the first picture
    :raises CalibrationError: the pictures have no markers in common
    """
    start = initialize_axis(views.observations, focal_lengths(camera), where)
    known = replace(start, camera_from_base=turntable.camera_from_base)
    free = FreeAxisParameters(base=False, scale=not isinstance(views.target, Markers))
    return _adjust(camera, views, known, free, PlatterPoints.empty())[0]


def _adjust(
    camera: Camera,
    views: PlatterViews,
    start: AxisState,
    free: FreeAxisParameters,
    platter_points: PlatterPoints,
) -> tuple[AxisAdjustment, Bools]:
    """Adjust, remove outlier corners, and adjust again."""
    focal = focal_lengths(camera)
    if isinstance(views.target, Markers) and not start.free_corners:
        start = start.with_free_corners(views.target.corners_xyz)
    first = adjust_axis(start, views.observations, focal, free, platter_points)
    kept = np.linalg.norm(first.residuals, axis=1) <= _OUTLIER * first.sigma
    kept |= _in_rejected_pictures(views.observations, kept)
    chosen = views.observations.select(kept)
    inflation = correlation_inflation(chosen, first.residuals[kept])
    adjusted = adjust_axis(first.axis, chosen, focal, free, platter_points, inflation)
    shifted = adjusted.axis.angles - adjusted.axis.angles[0]
    return replace(adjusted, axis=_relative_to_first(adjusted.axis, shifted)), kept


def _in_rejected_pictures(observations: CornerObservations, kept: Bools) -> Bools:
    """Return (n,) bool: corners of pictures of which no corner is an inlier."""
    count = np.bincount(observations.picture, kept)
    return np.asarray(count[observations.picture] == 0)


def _relative_to_first(axis: AxisState, angles: Floats) -> AxisState:
    """Return the state with angles relative to the first picture; layout and tilt compensate."""
    return axis.with_rotated_layout(float(axis.angles[0]), angles)


def x_towards_camera(axis: AxisState) -> AxisState:
    """Return the state with its base rotated about z so that x points to the camera."""
    center = transforms.invert(axis.camera_from_base)[:3, 3]
    azimuth = float(np.arctan2(center[1], center[0]))
    turn = transforms.rigid(transforms.rotation_z(azimuth), np.zeros(3))
    turned = replace(axis, camera_from_base=axis.camera_from_base @ turn)
    return turned.with_rotated_layout(-azimuth, axis.angles)


def _wobble(adjusted: AxisAdjustment) -> tuple[float, float]:
    tilt = adjusted.axis.tilt
    return float(np.linalg.norm(tilt)), float(np.sqrt(np.trace(adjusted.tilt_covariance)))


def _pose_covariance(adjusted: AxisAdjustment) -> Floats:
    """
    Return the (6, 6) covariance of translation and rotation in the camera's frame.

    The rotation about z is fixed by convention (x towards the camera): its variance is 0.
    """
    own = np.zeros((6, 6))
    order = [3, 4, 0, 1, 2]  # ωx, ωy, tx, ty, tz of the base among translation, rotation
    own[np.ix_(order, order)] = adjusted.covariance
    R = adjusted.axis.camera_from_base[:3, :3]
    turn = np.kron(np.eye(2), R)
    return np.asarray(turn @ own @ turn.T)


def _scale_check(target: Target, adjusted: AxisAdjustment) -> ScaleCheck:
    ratio = measured_ratio(target, adjusted.axis)
    return ScaleCheck(ratio=ratio, u=ratio * adjusted.size_u)


def _scale_source(target: Target, stripes: PlatterStripes | None) -> str:
    if stripes:
        return 'laser'
    return 'markers' if isinstance(target, Markers) else 'board'


def _require_pictures(views: PlatterViews, where: str) -> None:
    if len(views.pictures) < MIN_PICTURES:
        raise CalibrationError(
            f'{where}: {len(views.pictures)} pictures show {views.target}, at least '
            f'{MIN_PICTURES} are needed; take 12 or more, all around the turn'
        )


def _require_turn(axis: AxisState, where: str) -> None:
    gaps = np.diff(np.sort(np.mod(axis.angles, 2 * np.pi)), append=np.nan)
    gaps[-1] = 2 * np.pi - np.ptp(np.mod(axis.angles, 2 * np.pi))
    turn = 2 * np.pi - float(gaps.max())
    if turn < MIN_TURN:
        raise CalibrationError(
            f'{where}: the table turned by {np.degrees(turn):.1f} degrees in all pictures, '
            f'at least {np.degrees(MIN_TURN):.0f} are needed; take pictures all around the turn'
        )


def angle_steps(angles: Sequence[float]) -> Floats:
    """Return (n - 1,) radians from picture to picture, each in (-pi, pi]."""
    return np.diff(np.unwrap(np.asarray(angles)))
