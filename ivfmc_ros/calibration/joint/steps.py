# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The separate steps camera, lasers, turntable on one set of pictures: start of the joint one."""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.views import BoardViews
from ivfmc_ros.calibration.camera.calibrate import calibrate_camera
from ivfmc_ros.calibration.camera.calibrate import CameraCalibration
from ivfmc_ros.calibration.laser.calibrate import calibrate_laser
from ivfmc_ros.calibration.laser.calibrate import LaserCalibration
from ivfmc_ros.calibration.laser.calibrate import LaserSettings
from ivfmc_ros.calibration.turntable.calibrate import calibrate_turntable
from ivfmc_ros.calibration.turntable.calibrate import estimate_axis
from ivfmc_ros.calibration.turntable.calibrate import TurntableCalibration
from ivfmc_ros.calibration.turntable.observations import detect_targets
from ivfmc_ros.calibration.turntable.observations import Target
from ivfmc_ros.calibration.turntable.platter_stripes import find_platter_stripes
from ivfmc_ros.calibration.turntable.platter_stripes import PlatterStripes
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.laser import Stripe as Direction
from ivfmc_ros.progress import no_progress
from ivfmc_ros.progress import Progress


@dataclass(frozen=True, eq=False, kw_only=True)
class PictureSets:
    """
    Pictures of a calibration by what they show.

    board : detections of the board without a stripe, may be empty
    board_lasers : by laser, detections of the board with its stripe
    platter : the target on the platter
    platter_lasers : by laser, its stripe on the bare platter; may lack lasers
    """

    board: BoardViews
    board_lasers: Mapping[str, BoardViews]
    platter: tuple[Path, ...]
    platter_lasers: Mapping[str, tuple[Path, ...]]


@dataclass(frozen=True, kw_only=True)
class StepSettings:
    """
    Settings of the separate steps.

    model : distortion model
    square : keep fx = fy
    stripe : one stripe point per image row or column
    platter_radius : meters within which the platter is bare; None: to the corners of the target
    thickness : meters, of a board on the platter
    """

    model: str = 'plumb_bob'
    square: bool = True
    stripe: Direction = 'rows'
    platter_radius: float | None = None
    thickness: float = 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class SeparateSteps:
    """
    Results of the separate steps.

    lasers : by name
    platter_stripes : by laser
    """

    camera: CameraCalibration
    lasers: dict[str, LaserCalibration]
    turntable: TurntableCalibration
    platter_stripes: dict[str, PlatterStripes]


def run_steps(
    board: Board,
    target: Target,
    sets: PictureSets,
    settings: StepSettings | None = None,
    *,
    where: str = 'pictures',
    progress: Progress = no_progress,
) -> SeparateSteps:
    """
    Calibrate camera, lasers and turntable one after the other.

    :raises CalibrationError: a set does not determine its result
    :raises FileError: a picture cannot be read or has another size
    """
    settings = settings or StepSettings()
    camera = calibrate_camera(
        board, _all_views(sets), settings.model, square=settings.square, where=f'{where}: board'
    )
    lasers = {
        name: calibrate_laser(
            camera.camera,
            board,
            views,
            LaserSettings(name=name, stripe=settings.stripe),
            where=f'{where}: board with the stripe of {name}',
            progress=progress,
        )
        for name, views in sets.board_lasers.items()
    }
    turntable, stripes = _turntable(camera.camera, target, sets, lasers, settings, where, progress)
    return SeparateSteps(
        camera=camera, lasers=lasers, turntable=turntable, platter_stripes=stripes
    )


def _all_views(sets: PictureSets) -> BoardViews:
    parts = [sets.board, *sets.board_lasers.values()]
    return BoardViews(
        found=tuple(view for part in parts for view in part.found),
        missed=tuple(path for part in parts for path in part.missed),
        size=sets.board.size,
    )


def _turntable(
    camera: Camera,
    target: Target,
    sets: PictureSets,
    lasers: Mapping[str, LaserCalibration],
    settings: StepSettings,
    where: str,
    progress: Progress,
) -> tuple[TurntableCalibration, dict[str, PlatterStripes]]:
    views = detect_targets(camera, target, sets.platter, progress)
    first, _ = estimate_axis(camera, views, f'{where}: platter')
    radius = settings.platter_radius or first.axis.radius(views.observations)
    stripes = {
        name: find_platter_stripes(
            camera, lasers[name].laser, first.axis, radius, pictures, target, progress=progress
        )
        for name, pictures in _known(sets.platter_lasers, lasers).items()
    }
    result = calibrate_turntable(
        camera,
        views,
        first,
        next(iter(stripes.values()), None),
        thickness=settings.thickness,
        where=f'{where}: platter',
    )
    return result, stripes


def _known(
    pictures: Mapping[str, Sequence[Path]], lasers: Mapping[str, LaserCalibration]
) -> dict[str, Sequence[Path]]:
    return {name: found for name, found in pictures.items() if found and name in lasers}
