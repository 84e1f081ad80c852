# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Detection of a board or of ArUco markers on the platter, in pictures of a turning table."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board import find_corners
from ivfmc_ros.calibration.boards.edges import bloom_jacobian
from ivfmc_ros.calibration.boards.markers import find_markers
from ivfmc_ros.calibration.boards.markers import Markers
from ivfmc_ros.calibration.boards.views import for_each_picture
from ivfmc_ros.calibration.boards.views import MIN_CORNERS
from ivfmc_ros.calibration.boards.views import read_sized
from ivfmc_ros.calibration.turntable.axis import CornerObservations
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.errors import CalibrationError
from ivfmc_ros.model import Floats
from ivfmc_ros.progress import no_progress
from ivfmc_ros.progress import Progress

# A marker detected in fewer pictures is taken for a false detection.
_MIN_DETECTIONS = 3

Target = Board | Markers


@dataclass(frozen=True, eq=False, kw_only=True)
class PlatterViews:
    """
    Detections in pictures of a platter.

    pictures : those with a detection, in the order of ``observations.picture``
    missed : those without
    pixels : (n, 2) pixel of each corner of ``observations``, with lens distortion
    ids : marker id of each group; (0,) for a board
    """

    target: Target
    pictures: tuple[Path, ...]
    missed: tuple[Path, ...]
    observations: CornerObservations
    pixels: Floats
    ids: tuple[int, ...]


def detect_targets(
    camera: Camera, target: Target, pictures: Sequence[Path], progress: Progress = no_progress
) -> PlatterViews:
    """
    Detect a board or markers in pictures of a platter.

    :raises FileError: a picture cannot be read or has another size
    :raises CalibrationError: no target was detected in 3 pictures or more
    """

    def detect(path: Path) -> dict[int, tuple[list[int], Floats]]:
        image = read_sized(path, camera.size)
        if isinstance(target, Markers):
            return {n: ([0, 1, 2, 3], quad) for n, quad in find_markers(target, image).items()}
        corners = find_corners(target, image)
        if corners is None or len(corners) < MIN_CORNERS:
            return {}
        return {0: (corners.ids.tolist(), corners.uv)}

    detections = for_each_picture(detect, pictures, 'markers', progress)
    numbers = [number for targets in detections for number in targets]
    ids = tuple(sorted(n for n in set(numbers) if numbers.count(n) >= _MIN_DETECTIONS))
    if not ids:
        raise CalibrationError(
            f'{pictures[0].parent}: none of {len(pictures)} pictures shows {target}, or fewer '
            f'than {_MIN_DETECTIONS} do; check --board or --markers: dictionary and size'
        )
    rows = [{n: t for n, t in targets.items() if n in ids} for targets in detections]
    detected = [bool(targets) for targets in rows]
    observations, pixels = _collect(camera, target, [t for t in rows if t], ids)
    return PlatterViews(
        target=target,
        pictures=tuple(p for p, d in zip(pictures, detected, strict=True) if d),
        missed=tuple(p for p, d in zip(pictures, detected, strict=True) if not d),
        observations=observations,
        pixels=pixels,
        ids=ids,
    )


def focal_lengths(camera: Camera) -> Floats:
    """Return (2,) fx, fy in pixels."""
    return np.asarray(camera.K[[0, 1], [0, 1]])


def _collect(
    camera: Camera,
    target: Target,
    rows: Sequence[dict[int, tuple[list[int], Floats]]],
    ids: tuple[int, ...],
) -> tuple[CornerObservations, Floats]:
    targets = [
        (picture, ids.index(number), corners, uv)
        for picture, row in enumerate(rows)
        for number, (corners, uv) in row.items()
    ]
    corner = np.concatenate([corners for _, _, corners, _ in targets])
    counts = [len(corners) for _, _, corners, _ in targets]
    pixels = np.concatenate([uv for *_, uv in targets])
    observations = CornerObservations(
        picture=np.repeat([t[0] for t in targets], counts),
        group=np.repeat([t[1] for t in targets], counts),
        corner=corner,
        local_xyz=_upward_corners(target)[corner],
        uv=camera.rays(pixels)[:, :2] * focal_lengths(camera),
        bloom_jacobian=_bloom_jacobian(target, pixels),
    )
    return observations, pixels


def _bloom_jacobian(target: Target, pixels: Floats) -> Floats:
    """Return the derivative by the bloom: 0 for a chessboard, where both sides bloom alike."""
    if not isinstance(target, Markers):
        return np.zeros_like(pixels)
    return np.concatenate([bloom_jacobian(quad) for quad in pixels.reshape(-1, 4, 2)])


def _upward_corners(target: Target) -> Floats:
    """Return the corners in a frame with z up; the z axis of OpenCV's boards points down."""
    if isinstance(target, Markers):
        return target.corners_xyz
    return target.corners_xyz * (1.0, -1.0, 1.0)
