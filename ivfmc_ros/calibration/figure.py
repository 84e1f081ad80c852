# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of a calibration result (matplotlib): residuals, coverage, stripe, axis, table steps."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ivfmc_ros import files
from ivfmc_ros.calibration.camera.calibrate import CameraCalibration
from ivfmc_ros.calibration.laser.calibrate import LaserCalibration
from ivfmc_ros.calibration.laser.calibrate import LaserView
from ivfmc_ros.calibration.turntable.calibrate import angle_steps
from ivfmc_ros.calibration.turntable.calibrate import TurntableCalibration
from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.model import Floats
from ivfmc_ros.pictures import read_picture

_RED, _GREEN, _BLUE = '#d62728', '#2ca02c', '#1f77b4'
# Grid cells across the picture, one arrow of the mean residual in each.
_ARROW_COLUMNS = 12
# Share of a grid cell that the longest arrow takes.
_ARROW_SHARE = 0.8
_MIN_CORNERS_PER_ARROW = 10  # fewer corners give no stable mean


def draw_camera(path: Path, result: CameraCalibration) -> None:
    """
    Write a figure of residuals, their mean over the picture, and the rms of every view.

    :raises FileError: the file cannot be written
    """
    figure = _figure(16, 5.2)
    spots, places, bars = figure.subplots(1, 3, width_ratios=(1, 1.4, 1.2))
    residuals = np.concatenate(result.residuals)
    uv = np.concatenate([view.corners.uv for view in result.used])
    spots.scatter(*residuals.T, s=2, alpha=0.3, color=_BLUE, linewidths=0)
    limit = max(3.5 * result.rms, 1e-3)
    spots.set(xlim=(-limit, limit), ylim=(limit, -limit), aspect='equal')
    spots.set(xlabel='u error, px', ylabel='v error, px', title=f'rms {result.rms:.3f} px')
    spots.grid(alpha=0.3)
    scale = _draw_means(places, result.camera, uv, residuals)
    arrows = f'arrows: mean errors, {scale:,.0f} times' if scale else 'too few for mean errors'
    places.set_title(f'corners, px; {arrows}; {result.coverage:.0%} covered')
    bars.bar(range(len(result.used)), result.view_rms, color=_BLUE, width=1.0)
    bars.axhline(result.rms, color=_RED, linewidth=1)
    bars.set(xlabel='view', ylabel='rms, px')
    bars.set_title(f'{len(result.used)} views used, {len(result.dropped)} dropped')
    _save(figure, path)


def draw_laser(path: Path, result: LaserCalibration) -> None:
    """
    Write a figure of the stripe on two boards, and of the residuals by place and by view.

    :raises FileError: the file cannot be written
    """
    figure = _figure(16, 10)
    (near, far), (plane, views) = figure.subplots(2, 2)
    used = sorted(result.used, key=lambda view: float(view.board_pose.pose[5]))
    limit = 3e3 * result.laser.residual_rms
    _draw_stripe(near, used[0], limit)
    _draw_stripe(far, used[3 * len(used) // 4], limit)
    points = np.concatenate([view.points.points_xyz[view.inlier_mask] for view in used])
    residuals = 1e3 * np.concatenate([view.residuals[view.inlier_mask] for view in used])
    axes = _plane_axes(points)
    s, t = ((points - points.mean(axis=0)) @ axes.T).T * 1e3
    dots = plane.scatter(s, t, c=residuals, s=3, cmap='coolwarm', vmin=-limit, vmax=limit)
    figure.colorbar(dots, ax=plane, label='distance from the laser plane, mm')
    plane.set(xlabel='first axis in the plane, mm', ylabel='second axis, mm', aspect='equal')
    plane.set_title(f'{result.laser.name}: rms {result.laser.residual_rms * 1e3:.3f} mm')
    _draw_views(views, used)
    views.set_title(
        f'{len(used)} views used, {len(result.dropped)} dropped; '
        f'{result.inlier_fraction:.0%} of the points'
    )
    _save(figure, path)


def draw_turntable(path: Path, result: TurntableCalibration, camera: Camera) -> None:
    """
    Write a figure of axis, platter and corners in a picture, and of the steps of the table.

    :raises FileError: the file cannot be written
    """
    figure = _figure(16, 7)
    scene, steps = figure.subplots(1, 2, width_ratios=(1.6, 1))
    stripes = result.stripes
    source = result.views.pictures[0] if stripes is None else stripes.pictures[0]
    scene.imshow(_read_rgb(source))
    _draw_table(scene, result, camera)
    if source in result.views.pictures:
        _draw_corners(scene, result, camera, result.views.pictures.index(source))
    if stripes is not None:
        scene.plot(*stripes.uv[stripes.picture == 0].T, '.', color='yellow', markersize=2)
    scene.set_title(
        f'{source.name}: axis, circle through the outermost corner; cross: projected corner'
    )
    scene.axis('off')
    _draw_steps(steps, np.degrees(angle_steps(list(result.angles.values()))))
    steps.set_title(
        f'{steps.get_title()}\nresidual {result.adjusted.sigma:.2f} px; {_platter_text(result)}'
    )
    _save(figure, path)


def _draw_steps(axes: Any, degrees: Floats) -> None:
    """Draw how far each step of the table is from the median one: all of it hides the errors."""
    middle = float(np.median(degrees))
    axes.bar(range(1, 1 + len(degrees)), degrees - middle, color=_BLUE, width=0.9)
    axes.axhline(0, color='0.5', linewidth=1)
    # uneven steps on purpose are no errors: the scale then shows them
    limit = max(1.1 * float(np.abs(degrees - middle).max()), 1e-4)
    axes.set(xlabel='picture', ylabel='step less the median step, degrees', ylim=(-limit, limit))
    axes.set_title(f'median step {middle:.3f} degrees')


def _platter_text(result: TurntableCalibration) -> str:
    if result.platter_rms is None:
        return 'no stripe on the platter'
    return f'stripe on the platter {result.platter_rms * 1e3:.2f} mm rms'


def _draw_means(axes: Any, camera: Camera, uv: Floats, residuals: Floats) -> float:
    """Draw an arrow in each grid cell, and return how many times it is longer than the error."""
    axes.plot(*uv.T, '.', color='0.75', markersize=1)
    size = camera.width / _ARROW_COLUMNS
    cell = np.floor(uv / size).astype(int)
    cells = [(cell == key).all(axis=1) for key in np.unique(cell, axis=0)]
    filled = [inside for inside in cells if inside.sum() >= _MIN_CORNERS_PER_ARROW]
    means = np.array([residuals[inside].mean(axis=0) for inside in filled]).reshape(-1, 2)
    scale = arrow_scale(means, _ARROW_SHARE * size)
    for inside, mean in zip(filled, means, strict=True):
        middle = uv[inside].mean(axis=0)
        axes.annotate(
            '',
            xy=middle + scale * mean,
            xytext=middle,
            arrowprops={'arrowstyle': '->', 'color': _RED},
        )
    axes.set(xlim=(0, camera.width), ylim=(camera.height, 0), aspect='equal')
    return scale


def arrow_scale(means: Floats, longest: float) -> float:
    """
    Return the magnification, 1, 2 or 5 times a power of ten, of (n, 2) mean errors in pixels.

    longest : pixels that the longest arrow may take
    :returns: 0 where there is no arrow
    """
    largest = float(np.linalg.norm(means, axis=1).max(initial=0.0))
    if largest == 0.0:
        return 0.0
    power = 10.0 ** np.floor(np.log10(longest / largest))
    return float(max(step * power for step in (1, 2, 5) if step * power * largest <= longest))


def _draw_stripe(axes: Any, view: LaserView, limit: float) -> None:
    axes.imshow(_read_rgb(view.view.path))
    uv, kept = view.stripe.uv, view.inlier_mask
    axes.plot(*uv[~kept].T, 'x', color='yellow', markersize=3)
    axes.scatter(
        *uv[kept].T, c=1e3 * view.residuals[kept], s=4, cmap='coolwarm', vmin=-limit, vmax=limit
    )
    axes.plot(*view.view.corners.uv.T, '+', color=_GREEN, markersize=6)
    rms = 1e3 * float(np.sqrt(np.mean(view.residuals[kept] ** 2)))
    axes.set_title(f'{view.view.name}, {view.board_pose.pose[5]:.2f} m: {rms:.2f} mm rms')
    axes.axis('off')


def _draw_views(axes: Any, used: list[LaserView]) -> None:
    for view in used:
        residuals = 1e3 * view.residuals[view.inlier_mask]
        low, middle, high = np.percentile(residuals, [16, 50, 84])
        depth = float(view.points.points_xyz[:, 2].mean())
        axes.plot([depth, depth], [low, high], color=_BLUE, linewidth=1)
        axes.plot(depth, middle, 'o', color=_BLUE, markersize=3)
    axes.axhline(0, color='0.5', linewidth=1)
    axes.grid(alpha=0.3)
    axes.set(xlabel='distance from the camera, m', ylabel='distance from the laser plane, mm')


def _plane_axes(points: Floats) -> Floats:
    centered = points - points.mean(axis=0)
    return np.asarray(np.linalg.svd(centered, full_matrices=False)[2][:2])


def _draw_table(axes: Any, result: TurntableCalibration, camera: Camera) -> None:
    T = result.turntable.camera_from_base
    corners = result.adjusted.axis.corners_in_platter(result.views.observations)
    radius = float(np.linalg.norm(corners[:, :2], axis=1).max())
    turn = np.linspace(0, 2 * np.pi, 181)
    rim = radius * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    axes.plot(*camera.project(transforms.apply(T, rim)).T, color=_GREEN, linewidth=1.5)
    for end, color, name in (
        ((0, 0, 1.2 * radius), _BLUE, 'z'),
        ((0.6 * radius, 0, 0), _RED, 'x'),
        ((0, 0.6 * radius, 0), _GREEN, 'y'),
    ):
        line = camera.project(transforms.apply(T, np.array([(0.0, 0.0, 0.0), end])))
        axes.plot(*line.T, color=color, linewidth=2)
        axes.annotate(name, line[1], color=color, fontsize=14)


def _draw_corners(axes: Any, result: TurntableCalibration, camera: Camera, picture: int) -> None:
    here = result.views.observations.picture == picture
    axes.plot(*result.views.pixels[here].T, 'o', color='cyan', markersize=6, fillstyle='none')
    expected = result.adjusted.axis.corners_in_camera(result.views.observations)[here]
    axes.plot(*camera.project(expected).T, '+', color=_RED, markersize=6)


def _read_rgb(path: Path) -> Any:
    image = read_picture(path)
    if image.dtype == np.uint16:
        # the brightest value is full scale, as for the detection of the board
        image = (image * (255.0 / max(int(image.max(initial=0)), 255))).astype(np.uint8)
    code = cv2.COLOR_GRAY2RGB if image.ndim == 2 else cv2.COLOR_BGR2RGB
    return cv2.cvtColor(image, code)


def _figure(width: float, height: float) -> Any:
    # imported here: the import takes 0.5 s, and not every command draws
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=90, layout='constrained')


def _save(figure: Any, path: Path) -> None:
    with files.atomic_file(path) as temporary:
        figure.savefig(temporary)
