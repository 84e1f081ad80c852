# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Laser stripe on the bare platter: extraction, and triangulation by the calibrated laser."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from ivfmc_ros.calibration.boards.markers import find_markers
from ivfmc_ros.calibration.boards.markers import Markers
from ivfmc_ros.calibration.boards.views import for_each_picture
from ivfmc_ros.calibration.boards.views import read_sized
from ivfmc_ros.calibration.laser.stripes import BoardStripe
from ivfmc_ros.calibration.laser.stripes import extract_board_stripe
from ivfmc_ros.calibration.turntable.axis import AxisState
from ivfmc_ros.calibration.turntable.axis import PlatterPoints
from ivfmc_ros.calibration.turntable.observations import Target
from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.cell.laser import Stripe as Direction
from ivfmc_ros.errors import CalibrationError
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.progress import no_progress
from ivfmc_ros.progress import Progress
from ivfmc_ros.stripe.extract import ExtractSettings

_STEP_PIXEL = 0.25  # pixels, of the numerical Jacobian
# Markers are masked with this fraction of their size around them.
_MARKER_MARGIN = 0.15


@dataclass(frozen=True, eq=False, kw_only=True)
class PlatterStripes:
    """
    Stripe points on a platter.

    picture : (n,) index into ``pictures``
    uv : (n, 2) pixel
    pixel_sigma : (pictures,) 1 sigma of a stripe position, pixels
    platter_points : the triangulated points, with the 1 sigma of their heights
    """

    pictures: tuple[Path, ...]
    picture: np.ndarray[tuple[int], np.dtype[np.int64]]
    uv: Floats
    pixel_sigma: Floats
    platter_points: PlatterPoints


def find_platter_stripes(
    camera: Camera,
    laser: LaserPlane,
    axis: AxisState,
    radius: float,
    pictures: Sequence[Path],
    target: Target,
    *,
    settings: ExtractSettings | None = None,
    progress: Progress = no_progress,
) -> PlatterStripes:
    """
    Extract and triangulate the stripe on the platter in each picture.

    axis : where the platter is, to a centimeter
    radius : meters about the axis, within which the platter is used
    target : markers are masked
    :raises CalibrationError: no picture shows the stripe
    """
    found = extract_platter_stripes(
        camera,
        axis.camera_from_base,
        radius,
        pictures,
        target if isinstance(target, Markers) else None,
        laser.stripe,
        settings or ExtractSettings(),
        progress,
    )
    uv = np.concatenate([stripe for _, stripe, _ in found])
    picture = np.repeat(np.arange(len(found)), [len(stripe) for _, stripe, _ in found])
    sigma = np.repeat([s for *_, s in found], [len(stripe) for _, stripe, _ in found])
    platter_points, seen = _stripe_heights(camera, laser, axis, uv, sigma)
    return PlatterStripes(
        pictures=tuple(path for path, *_ in found),
        picture=picture[seen],
        uv=uv[seen],
        pixel_sigma=np.array([s for *_, s in found]),
        platter_points=platter_points,
    )


def extract_platter_stripes(
    camera: Camera,
    camera_from_base: Floats,
    radius: float,
    pictures: Sequence[Path],
    markers: Markers | None,
    stripe: Direction,
    settings: ExtractSettings,
    progress: Progress,
) -> list[tuple[Path, Floats, float]]:
    """
    Extract the stripe on the bare platter.

    returns : for each picture with a stripe: path, (n, 2) pixels and their 1 sigma in pixels
    :raises CalibrationError: no picture shows the stripe
    """
    disc = platter_mask(camera, camera_from_base, radius)

    def extract_stripe(path: Path) -> BoardStripe | None:
        image = read_sized(path, camera.size)
        bare = disc & ~_marker_mask(
            image.shape, {} if not markers else find_markers(markers, image)
        )
        return extract_board_stripe(image, bare, camera, stripe, settings)

    seen = for_each_picture(extract_stripe, pictures, 'platter', progress)
    found = [(path, s.uv, s.sigma) for path, s in zip(pictures, seen, strict=True) if s]
    if not found:
        raise CalibrationError(
            f'{pictures[0].parent}: no picture shows the stripe on the bare platter; '
            'take some with the laser on and an empty platter'
        )
    return found


def platter_mask(camera: Camera, camera_from_base: Floats, radius: float) -> Bools:
    """Return (height, width) bool: pixels of the platter within ``radius`` meters of the axis."""
    angle = np.linspace(0, 2 * np.pi, 180, endpoint=False)
    rim = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    uv = camera.project(transforms.apply(camera_from_base, rim))
    mask = np.zeros((camera.height, camera.width), dtype=np.uint8)
    cv2.fillPoly(mask, [np.clip(uv, -5000, 20000).round().astype(np.int32)], (1,))
    return mask > 0


def _marker_mask(shape: tuple[int, ...], markers: dict[int, Floats]) -> Bools:
    mask = np.zeros(shape[:2], dtype=np.uint8)
    for quad in markers.values():
        grown = quad + _MARKER_MARGIN * (quad - quad.mean(axis=0))
        cv2.fillPoly(mask, [grown.round().astype(np.int32)], (1,))
    return mask > 0


def _stripe_heights(
    camera: Camera, laser: LaserPlane, axis: AxisState, uv: Floats, sigma: Floats
) -> tuple[PlatterPoints, Bools]:
    """
    Triangulate stripe points and estimate the 1 sigma of their heights.

    The error of the laser plane is common to all n points and does not average out: each point
    gets n times the plane's variance, plus the variance of its own pixel.
    """
    rays = camera.rays(uv)
    points = laser.intersect(rays)
    step = np.array([_STEP_PIXEL, 0.0] if laser.stripe == 'rows' else [0.0, _STEP_PIXEL])
    moved = laser.intersect(camera.rays(uv + step))
    up = axis.camera_from_base[:3, 2]
    pixel_jacobian = sigma * np.abs((moved - points) @ up) / _STEP_PIXEL
    covariance = laser.covariance
    if covariance is None:
        covariance = np.diag([0.0, 0.0, 0.0, laser.residual_rms**2])
    design = np.column_stack([points, np.ones(len(points))])
    plane = np.einsum('ni,ij,nj->n', design, covariance, design)
    by_plane = plane * (rays @ up / (rays @ laser.normal)) ** 2
    total = np.sqrt(pixel_jacobian**2 + len(uv) * by_plane)
    seen = np.isfinite(total) & (total > 0)
    return PlatterPoints(points_xyz=points[seen], sigma=total[seen]), seen
