# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The table's axis, its platter and the angles of pictures, from a board or markers on it."""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace

import numpy as np

from ivfmc_ros.calibration.boards.markers import Markers
from ivfmc_ros.calibration.turntable.axis import Axis
from ivfmc_ros.calibration.turntable.axis import Heights
from ivfmc_ros.calibration.turntable.axis import Sightings
from ivfmc_ros.calibration.turntable.axis_adjust import adjust_axis
from ivfmc_ros.calibration.turntable.axis_adjust import Adjusted
from ivfmc_ros.calibration.turntable.axis_adjust import FreeAxis
from ivfmc_ros.calibration.turntable.axis_adjust import likeness
from ivfmc_ros.calibration.turntable.axis_start import start_axis
from ivfmc_ros.calibration.turntable.platter import PlatterStripes
from ivfmc_ros.calibration.turntable.sightings import focal_lengths
from ivfmc_ros.calibration.turntable.sightings import PlatterViews
from ivfmc_ros.calibration.turntable.sightings import Target
from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.cell import Turntable
from ivfmc_ros.errors import CalibrationError
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats

MIN_PICTURES = 5
MIN_TURN = np.radians(60.0)
_MAX_STD = 1e-3
# A corner further off than this many sigmas was lit by the stripe or half hidden.
_OUTLIER = 4.5


@dataclass(frozen=True, eq=False, kw_only=True)
class TurntableCalibration:
    """
    A turntable and how well the pictures determine it.

    views : what was seen; ``adjusted.residuals`` are of its sightings that ``kept`` chooses
    scale_source : 'laser' if stripes on the platter gave the scale, else 'markers' or 'board'
    scale : measured length of board or markers over what they are said to be
    platter_rms : metres, of the stripe points about the platter's plane; None without stripes
    wobble : radians between the platter's normal and the axis
    """

    turntable: Turntable
    views: PlatterViews
    adjusted: Adjusted
    kept: Bools
    stripes: PlatterStripes | None
    scale_source: str
    scale: float
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
        """Whether the table turns counter-clockwise seen from above, picture after picture."""
        return bool(np.median(np.diff(list(self.angles.values()))) > 0)


def first_axis(camera: Camera, views: PlatterViews, where: str) -> tuple[Adjusted, Bools]:
    """
    Adjust with the lengths of board or markers believed.

    returns : the result, and (n,) bool: which sightings were kept
    :raises CalibrationError: the pictures do not determine an axis
    """
    _require_pictures(views, where)
    focal = focal_lengths(camera)
    start = start_axis(views.sightings, focal, where)
    _require_turn(start, where)
    return _adjust(camera, views, start, free_for(views.target, None), Heights.none())


def free_for(target: Target, stripes: PlatterStripes | None) -> FreeAxis:
    """Return what may change: the scale belongs to the stripes if there are any."""
    if isinstance(target, Markers):
        return FreeAxis(side=None if stripes else target.side, scale=False)
    return FreeAxis(scale=stripes is not None)


def calibrate_turntable(
    camera: Camera,
    views: PlatterViews,
    first: Adjusted,
    stripes: PlatterStripes | None = None,
    *,
    thickness: float = 0.0,
    where: str = 'pictures',
) -> TurntableCalibration:
    """
    Calibrate a turntable.

    first : from ``first_axis``
    thickness : metres, of the board on the platter
    :raises CalibrationError: the axis stays too uncertain
    """
    heights = stripes.heights if stripes else Heights.none()
    free = free_for(views.target, stripes)
    adjusted, kept = _adjust(camera, views, first.axis, free, heights)
    axis = _towards_camera(adjusted.axis)
    adjusted = replace(adjusted, axis=axis)
    if np.sqrt(np.diag(adjusted.covariance)[2:4].max()) > _MAX_STD:
        raise CalibrationError(
            f'{where}: the axis stays uncertain by more than {_MAX_STD * 1e3:g} mm; '
            'take pictures at more angles all around, nearer, or with larger markers'
        )
    residual = np.linalg.norm(adjusted.residuals, axis=1)
    depth = axis.camera_points(views.sightings)[kept][:, 2]
    lengths = residual * depth / focal_lengths(camera).mean()
    rms = None
    if stripes:
        rms = float(np.sqrt(np.mean(axis.heights(stripes.heights.points_xyz) ** 2)))
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
        kept=kept,
        stripes=stripes,
        scale_source=_scale_source(views.target, stripes),
        scale=_scale(views.target, axis),
        platter_rms=rms,
        wobble=wobble,
        wobble_std=wobble_std,
    )


def measure_angles(
    camera: Camera, turntable: Turntable, views: PlatterViews, where: str = 'pictures'
) -> Adjusted:
    """
    Measure the table angle of pictures taken in a calibrated cell.

    returns : ``axis.angles`` are radians, 0 for the first picture
    :raises CalibrationError: the pictures have no markers in common
    """
    start = start_axis(views.sightings, focal_lengths(camera), where)
    known = replace(start, camera_from_base=turntable.camera_from_base)
    free = FreeAxis(base=False, scale=not isinstance(views.target, Markers))
    return _adjust(camera, views, known, free, Heights.none())[0]


def _adjust(
    camera: Camera, views: PlatterViews, start: Axis, free: FreeAxis, heights: Heights
) -> tuple[Adjusted, Bools]:
    """Adjust, leave out corners that are far off, and adjust again."""
    focal = focal_lengths(camera)
    if isinstance(views.target, Markers) and not start.free:
        start = start.freed(views.target.corners_xyz)
    first = adjust_axis(start, views.sightings, focal, free, heights)
    kept = np.linalg.norm(first.residuals, axis=1) <= _OUTLIER * first.sigma
    kept |= _last_of_picture(views.sightings, kept)
    chosen = views.sightings.chosen(kept)
    inflation = likeness(chosen, first.residuals[kept])
    adjusted = adjust_axis(first.axis, chosen, focal, free, heights, inflation)
    shifted = adjusted.axis.angles - adjusted.axis.angles[0]
    return replace(adjusted, axis=_from_first(adjusted.axis, shifted)), kept


def _last_of_picture(sightings: Sightings, kept: Bools) -> Bools:
    """Tell which corners belong to pictures of which none would be kept."""
    count = np.bincount(sightings.picture, kept)
    return np.asarray(count[sightings.picture] == 0)


def _from_first(axis: Axis, angles: Floats) -> Axis:
    """Count angles from the first picture's: layout and tilt turn the other way."""
    return axis.turned_layout(float(axis.angles[0]), angles)


def _towards_camera(axis: Axis) -> Axis:
    """Turn the base about its z so that its x points to the camera."""
    centre = transforms.invert(axis.camera_from_base)[:3, 3]
    azimuth = float(np.arctan2(centre[1], centre[0]))
    turn = transforms.rigid(transforms.rotation_z(azimuth), np.zeros(3))
    turned = replace(axis, camera_from_base=axis.camera_from_base @ turn)
    return turned.turned_layout(-azimuth, axis.angles)


def _wobble(adjusted: Adjusted) -> tuple[float, float]:
    tilt = adjusted.axis.tilt
    return float(np.linalg.norm(tilt)), float(np.sqrt(np.trace(adjusted.tilt_covariance)))


def _pose_covariance(adjusted: Adjusted) -> Floats:
    """
    Return the (6, 6) covariance of translation and rotation in the camera's frame.

    The rotation about z is set by convention and carries no uncertainty of its own.
    """
    own = np.zeros((6, 6))
    order = [3, 4, 0, 1, 2]  # ωx, ωy, tx, ty, tz of the base among translation, rotation
    own[np.ix_(order, order)] = adjusted.covariance
    R = adjusted.axis.camera_from_base[:3, :3]
    turn = np.kron(np.eye(2), R)
    return np.asarray(turn @ own @ turn.T)


def _scale(target: Target, axis: Axis) -> float:
    return axis.mean_side() / target.side if isinstance(target, Markers) else axis.scale


def _scale_source(target: Target, stripes: PlatterStripes | None) -> str:
    if stripes:
        return 'laser'
    return 'markers' if isinstance(target, Markers) else 'board'


def _require_pictures(views: PlatterViews, where: str) -> None:
    if len(views.pictures) < MIN_PICTURES:
        raise CalibrationError(
            f'{where}: {len(views.pictures)} pictures show {views.target}, {MIN_PICTURES} is '
            'least; take 12 or more all around the turn'
        )


def _require_turn(axis: Axis, where: str) -> None:
    gaps = np.diff(np.sort(np.mod(axis.angles, 2 * np.pi)), append=np.nan)
    gaps[-1] = 2 * np.pi - np.ptp(np.mod(axis.angles, 2 * np.pi))
    turn = 2 * np.pi - float(gaps.max())
    if turn < MIN_TURN:
        raise CalibrationError(
            f'{where}: the table turned by {np.degrees(turn):.1f} degrees in all pictures, '
            f'{np.degrees(MIN_TURN):.0f} is least; take pictures all around the turn'
        )


def steps_of(angles: Sequence[float]) -> Floats:
    """Return (n - 1,) radians from picture to picture, the shorter way."""
    return np.diff(np.unwrap(np.asarray(angles)))
