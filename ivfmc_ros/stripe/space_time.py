# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
When the sheet passes a point of the surface, instead of where it is in one picture.

A point of the part keeps its reflectance while it turns through the sheet, so that its
brightness over the pictures is the sheet's profile, also where the surface changes color or
ends (Curless and Levoy 1995, Better Optical Triangulation through Spacetime Analysis). A point
is followed through the pictures before and after along the way that the table takes it; they
move a surface by a shift, a turntable by an arc.
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
from ivfmc_ros.stripe.estimators.patches import Estimate
from ivfmc_ros.stripe.estimators.patches import FULL
from ivfmc_ros.stripe.estimators.patches import Patches
from ivfmc_ros.stripe.noise import Noise
from ivfmc_ros.stripe.peaks import Peaks
from ivfmc_ros.stripe.settings import ExtractSettings
from ivfmc_ros.stripe.stripe import Stripe
from ivfmc_ros.stripe.triangulate import triangulate

# So many pictures must show a point, or the time of its peak is a guess.
_LEAST = 5
# A point whose time is off by more than so many sheet widths is not the one that was followed.
_FARTHEST = 2.0
_PROBE = 0.05  # pictures


def refine(
    cell: Cell, frames: Sequence[Frame], index: int, stripe: Stripe, settings: ExtractSettings
) -> Profile:
    """
    Return the profile of ``frames[index]``, each of its points seen in all ``frames``.

    frames : consecutive pictures of one sweep of one laser
    stripe : of ``frames[index]``, from this picture alone
    returns : the points in ``turntable``; ``uv`` stays where the picture alone has the stripe.
        What the other pictures do not confirm is left out.
    """
    frame = frames[index]
    start = triangulate(cell, frame, stripe)
    angles = np.array([other.angle for other in frames])
    # of a single picture nothing is confirmed
    step = float(np.median(np.diff(angles))) if len(angles) > 1 else 0.0
    traces, shown = _follow(cell, frames, start.points_xyz, settings)
    patches = _patches(traces, shown, np.arange(len(frames)) - index)
    estimate = fit(patches, settings.noise or Noise())
    good = _confirmed(patches, estimate, len(frames))
    late = estimate.place[good]
    points = start.points_xyz[good]
    found, before, after = (
        _crossing(cell, frame, points, frame.angle + step * (late + probe))
        for probe in (0.0, -_PROBE, _PROBE)
    )
    pace = np.linalg.norm(after - before, axis=1) / (2.0 * _PROBE)
    return Profile(
        points_xyz=found,
        intensity=estimate.height[good],
        sigma=estimate.sigma[good] * pace,
        uv=start.uv[good],
        angle=frame.angle,
        laser=frame.laser,
        view=frame.view,
        seq=frame.seq,
        stamp_ns=frame.stamp_ns,
        speed=frame.speed,
    )


def _follow(
    cell: Cell, frames: Sequence[Frame], points: Floats, settings: ExtractSettings
) -> tuple[Singles, Bools]:
    """Return grey values (0 to 255) of points in each picture, (n, frames), and where seen."""
    traces = np.zeros((len(points), len(frames)), dtype=np.float32)
    shown = np.zeros(traces.shape, dtype=bool)
    if not len(points):
        return traces, shown
    size = np.array(cell.camera.size)
    for k, frame in enumerate(frames):
        grey = channel.to_grey(frame.image, settings.channel)
        uv = cell.camera.project(cell.turntable.to_camera(points, frame.angle))
        shown[:, k] = ((uv >= 0) & (uv <= size - 1)).all(axis=1)
        u, v = np.ascontiguousarray(uv.T[..., None], dtype=np.float32)
        values = cv2.remap(grey.astype(np.float32), u, v, cv2.INTER_LINEAR)
        traces[:, k] = np.asarray(values)[:, 0] * (255.0 / np.iinfo(grey.dtype).max)
    return traces, shown


def _patches(traces: Singles, shown: Bools, steps: Ints) -> Patches:
    """Return traces as if they were rows of a picture, whose columns are pictures."""
    level = np.sort(traces, axis=1)[:, : max(1, len(steps) // 4)].mean(axis=1)
    above = np.maximum(traces - level[:, None], 0.0)
    peak = above.argmax(axis=1)
    height = np.maximum(above.max(axis=1), 1.0)
    # a Gaussian's area over its height
    width = above.sum(axis=1) / height / np.sqrt(2.0 * np.pi)
    column = np.zeros(len(traces), dtype=np.int64)
    used = (shown & (traces < FULL)).astype(np.float32)
    middle = steps[peak].astype(np.float32)
    rough = Peaks(column, middle, np.clip(width, 0.5, len(steps)), height, level, level + height)
    return Patches(steps.astype(np.float32), column, traces, used, rough)


def _confirmed(patches: Patches, estimate: Estimate, count: int) -> Bools:
    seen = patches.used.sum(axis=1)
    ends = np.abs(estimate.place) < np.minimum(_FARTHEST * estimate.width, 0.5 * count)
    return np.asarray((seen >= _LEAST) & ends & (estimate.snr > 3.0) & (estimate.width < count))


def _crossing(cell: Cell, frame: Frame, points: Floats, angles: Floats) -> Floats:
    """Return where the sheet is on the ray on which points are seen at angles (n,)."""
    turned = _turned(points, angles)
    camera = cell.turntable.to_camera(turned, 0.0)
    met = cell.lasers[frame.laser].intersect(camera / camera[:, 2:])
    return _turned(cell.turntable.to_part(met, 0.0), -angles)


def _turned(points: Floats, angles: Floats) -> Floats:
    """Return points (n, 3) turned about +z by an angle each."""
    cosine, sine = np.cos(angles), np.sin(angles)
    x, y, z = points.T
    return np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=1)
