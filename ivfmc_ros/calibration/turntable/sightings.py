# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What pictures of a platter show of the board or the markers on it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board import find_corners
from ivfmc_ros.calibration.boards.edges import inward
from ivfmc_ros.calibration.boards.markers import find_markers
from ivfmc_ros.calibration.boards.markers import Markers
from ivfmc_ros.calibration.boards.views import for_each_picture
from ivfmc_ros.calibration.boards.views import MIN_CORNERS
from ivfmc_ros.calibration.boards.views import read_sized
from ivfmc_ros.calibration.turntable.axis import Sightings
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.errors import CalibrationError
from ivfmc_ros.model import Floats
from ivfmc_ros.progress import Progress
from ivfmc_ros.progress import silent

# A marker that is found in fewer pictures is a misreading of something else.
_MIN_TIMES = 3

Target = Board | Markers


@dataclass(frozen=True, eq=False, kw_only=True)
class PlatterViews:
    """
    Pictures of a platter.

    pictures : those that show something, in the order of ``sightings.picture``
    without : those that do not
    pixels : (n, 2) where each corner of ``sightings`` was seen, with lens distortion
    ids : the marker that each group is; (0,) for a board
    """

    target: Target
    pictures: tuple[Path, ...]
    without: tuple[Path, ...]
    sightings: Sightings
    pixels: Floats
    ids: tuple[int, ...]


def see_platter(
    camera: Camera, target: Target, pictures: Sequence[Path], progress: Progress = silent
) -> PlatterViews:
    """
    Look for board or markers in pictures of a platter.

    :raises FileError: a picture cannot be read or has another size
    :raises CalibrationError: none shows them
    """

    def look(path: Path) -> dict[int, tuple[list[int], Floats]]:
        image = read_sized(path, camera.size)
        if isinstance(target, Markers):
            return {n: ([0, 1, 2, 3], quad) for n, quad in find_markers(target, image).items()}
        corners = find_corners(target, image)
        if corners is None or len(corners) < MIN_CORNERS:
            return {}
        return {0: (corners.ids.tolist(), corners.uv)}

    seen = for_each_picture(look, pictures, 'markers', progress)
    times = [number for things in seen for number in things]
    ids = tuple(sorted(n for n in set(times) if times.count(n) >= _MIN_TIMES))
    if not ids:
        raise CalibrationError(
            f'{pictures[0].parent}: none of {len(pictures)} pictures shows {target} '
            'often enough; check --board or --markers: dictionary and size'
        )
    rows = [{n: t for n, t in things.items() if n in ids} for things in seen]
    shown = [bool(things) for things in rows]
    sightings, pixels = _collect(camera, target, [t for t in rows if t], ids)
    return PlatterViews(
        target=target,
        pictures=tuple(p for p, s in zip(pictures, shown, strict=True) if s),
        without=tuple(p for p, s in zip(pictures, shown, strict=True) if not s),
        sightings=sightings,
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
) -> tuple[Sightings, Floats]:
    things = [
        (picture, ids.index(number), corners, uv)
        for picture, row in enumerate(rows)
        for number, (corners, uv) in row.items()
    ]
    corner = np.concatenate([corners for _, _, corners, _ in things])
    counts = [len(corners) for _, _, corners, _ in things]
    pixels = np.concatenate([uv for *_, uv in things])
    sightings = Sightings(
        picture=np.repeat([t[0] for t in things], counts),
        group=np.repeat([t[1] for t in things], counts),
        corner=corner,
        local_xyz=_face_up(target)[corner],
        uv=camera.rays(pixels)[:, :2] * focal_lengths(camera),
        inward=_inward(target, pixels),
    )
    return sightings, pixels


def _inward(target: Target, pixels: Floats) -> Floats:
    """Return how corners move if edges do; those of a chessboard stay, both sides give way."""
    if not isinstance(target, Markers):
        return np.zeros_like(pixels)
    return np.concatenate([inward(quad) for quad in pixels.reshape(-1, 4, 2)])


def _face_up(target: Target) -> Floats:
    """Return the corners of the target with its z upwards; OpenCV's boards have it into them."""
    if isinstance(target, Markers):
        return target.corners_xyz
    return target.corners_xyz * (1.0, -1.0, 1.0)
