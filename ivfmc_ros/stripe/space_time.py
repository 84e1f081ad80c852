# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Space-time analysis: the time at which a surface point crosses the laser plane, from many images.

A point of the part keeps its reflectance while it turns through the laser plane; its brightness
over time is therefore the profile of the laser, even at edges and changes of reflectance
(Curless and Levoy 1995, Better Optical Triangulation through Spacetime Analysis, with a
translation of the part; here the table rotates it, and each point is projected into the images
before and after).
"""

from collections.abc import Sequence

import cv2
import numpy as np

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Profile
from ivfmc_ros.model import Singles
from ivfmc_ros.stripe import channel
from ivfmc_ros.stripe.estimators.gaussian import fit
from ivfmc_ros.stripe.estimators.patches import CLIPPING_LEVEL
from ivfmc_ros.stripe.estimators.patches import Patches
from ivfmc_ros.stripe.estimators.patches import PeakEstimate
from ivfmc_ros.stripe.noise import SensorNoise
from ivfmc_ros.stripe.peaks import Peaks
from ivfmc_ros.stripe.settings import ExtractSettings
from ivfmc_ros.stripe.stripe import Stripe
from ivfmc_ros.stripe.triangulate import triangulate

# Minimum number of images that show a point; the fit has four parameters.
_MIN_IMAGES = 5
# Largest time offset, in sigmas of the temporal profile, of a peak that belongs to the point.
_MAX_OFFSET_SIGMAS = 2.0
# Images; half step of the numerical derivative of the position by time.
_HALF_STEP = 0.05
# Minimum signal-to-noise ratio of the temporal peak.
_MIN_SNR = 3.0


def space_time_profile(
    cell: Cell, frames: Sequence[Frame], index: int, stripe: Stripe, settings: ExtractSettings
) -> Profile:
    """
    Return the profile of ``frames[index]`` by space-time analysis of all ``frames``.

    frames : consecutive frames of one sweep of one laser
    stripe : stripe of ``frames[index]``, extracted from this image alone
    returns : points in ``turntable``, without those that the other images do not confirm; ``uv``
        is that of ``stripe``
    """
    frame = frames[index]
    start = triangulate(cell, frame, stripe)
    angles = np.array([other.angle for other in frames])
    # a single image confirms no point
    step = float(np.median(np.diff(angles))) if len(angles) > 1 else 0.0
    traces, visible = _traces(cell, frames, start.points_xyz, settings)
    patches = _patches(traces, visible, np.arange(len(frames)) - index)
    estimate = fit(patches, settings.noise or SensorNoise())
    good = _confirmed(patches, estimate, len(frames))
    delay = estimate.position[good]
    points = start.points_xyz[good]
    found, before, after = (
        _crossing(cell, frame, points, frame.angle + step * (delay + shift))
        for shift in (0.0, -_HALF_STEP, _HALF_STEP)
    )
    meters_per_image = np.linalg.norm(after - before, axis=1) / (2.0 * _HALF_STEP)
    return Profile(
        points_xyz=found,
        intensity=estimate.height[good],
        sigma=estimate.sigma[good] * meters_per_image,
        uv=start.uv[good],
        angle=frame.angle,
        laser=frame.laser,
        view=frame.view,
        seq=frame.seq,
        stamp_ns=frame.stamp_ns,
        speed=frame.speed,
    )


def _traces(
    cell: Cell, frames: Sequence[Frame], points: Floats, settings: ExtractSettings
) -> tuple[Singles, Bools]:
    """Return gray values (0 to 255) of points in each image and a visibility mask, (n, frames)."""
    traces = np.zeros((len(points), len(frames)), dtype=np.float32)
    visible = np.zeros(traces.shape, dtype=bool)
    if not len(points):
        return traces, visible
    size = np.array(cell.camera.size)
    for k, frame in enumerate(frames):
        gray = channel.to_gray(frame.image, settings.channel)
        uv = cell.camera.project(cell.turntable.to_camera(points, frame.angle))
        visible[:, k] = ((uv >= 0) & (uv <= size - 1)).all(axis=1)
        u, v = np.ascontiguousarray(uv.T[..., None], dtype=np.float32)
        values = cv2.remap(gray.astype(np.float32), u, v, cv2.INTER_LINEAR)
        traces[:, k] = np.asarray(values)[:, 0] * (255.0 / np.iinfo(gray.dtype).max)
    return traces, visible


def _patches(traces: Singles, visible: Bools, steps: Ints) -> Patches:
    """Return traces as patches, whose columns are images instead of pixels."""
    level = np.sort(traces, axis=1)[:, : max(1, len(steps) // 4)].mean(axis=1)
    above = np.maximum(traces - level[:, None], 0.0)
    peak = above.argmax(axis=1)
    height = np.maximum(above.max(axis=1), 1.0)
    # sigma of a Gaussian from its area and height
    width = above.sum(axis=1) / height / np.sqrt(2.0 * np.pi)
    column = np.zeros(len(traces), dtype=np.int64)
    used = (visible & (traces < CLIPPING_LEVEL)).astype(np.float32)
    middle = steps[peak].astype(np.float32)
    rough = Peaks(column, middle, np.clip(width, 0.5, len(steps)), height, level, level + height)
    return Patches(steps.astype(np.float32), column, traces, used, rough)


def _confirmed(patches: Patches, estimate: PeakEstimate, count: int) -> Bools:
    seen = patches.used.sum(axis=1)
    close = np.abs(estimate.position) < np.minimum(
        _MAX_OFFSET_SIGMAS * estimate.width, 0.5 * count
    )
    return np.asarray(
        (seen >= _MIN_IMAGES) & close & (estimate.snr > _MIN_SNR) & (estimate.width < count)
    )


def _crossing(cell: Cell, frame: Frame, points: Floats, angles: Floats) -> Floats:
    """Intersect the laser plane with the rays to points at table angles (n,), in turntable."""
    rotated = _rotated(points, angles)
    camera = cell.turntable.to_camera(rotated, 0.0)
    intersection = cell.lasers[frame.laser].intersect(camera / camera[:, 2:])
    return _rotated(cell.turntable.to_part(intersection, 0.0), -angles)


def _rotated(points: Floats, angles: Floats) -> Floats:
    """Rotate points (n, 3) about +z by angles (n,), radians."""
    cosine, sine = np.cos(angles), np.sin(angles)
    x, y, z = points.T
    return np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=1)
