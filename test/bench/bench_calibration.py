# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Calibration on rendered boards with known truth, and on real pictures."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
import tempfile

import cv2
import numpy as np
from scipy.optimize import least_squares
from support.real_scan import measured_scan

from bench import at_most
from bench import Number
from ivfmc_ros.calibration.boards.board import parse_board
from ivfmc_ros.calibration.boards.markers import parse_markers
from ivfmc_ros.calibration.boards.views import find_views
from ivfmc_ros.calibration.camera.calibrate import calibrate_camera
from ivfmc_ros.calibration.camera.calibrate import CameraCalibration
from ivfmc_ros.calibration.laser.calibrate import calibrate_laser
from ivfmc_ros.calibration.laser.calibrate import LaserSettings
from ivfmc_ros.calibration.turntable.calibrate import calibrate_turntable
from ivfmc_ros.calibration.turntable.calibrate import estimate_axis
from ivfmc_ros.calibration.turntable.calibrate import TurntableCalibration
from ivfmc_ros.calibration.turntable.observations import detect_targets
from ivfmc_ros.calibration.turntable.platter_stripes import find_platter_stripes
from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.model import Floats
from ivfmc_ros.pictures import list_pictures
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.bench import LASER_AZIMUTHS
from ivfmc_ros.simulation.boards.pictures import render_board
from ivfmc_ros.simulation.boards.pictures import render_platter_board
from ivfmc_ros.simulation.boards.pictures import scatter_poses

CHESSBOARD = parse_board('chessboard:17x12:8mm')
CHARUCO = parse_board('charuco:10x7:12mm:9mm:DICT_4X4_50')
CAMERA_VIEWS, LASER_VIEWS, TABLE_VIEWS = 40, 25, 24
SPHERE = 0.025  # radius, meters


def run() -> Iterator[Number]:
    with tempfile.TemporaryDirectory() as folder:
        yield from rendered(Path(folder))
    data = measured_scan()
    if data is not None:
        yield from real(data)


def rendered(folder: Path) -> Iterator[Number]:
    truth = bench_cell()
    render(truth, folder)
    result = calibrate_camera(CHESSBOARD, find_views(CHESSBOARD, list_pictures(folder / 'camera')))
    camera = result.camera
    yield Number('rendered camera rms', result.rms, 'px', None, f'{len(result.used)} views')
    error = float(camera.K[0, 0] - truth.camera.K[0, 0])
    yield Number(
        'focal length error', error, 'px', None, f'claimed 1 sigma {result.std["fx"]:.3f}'
    )
    lasers = []
    for number, true in enumerate(truth.lasers):
        views = find_views(
            CHESSBOARD, list_pictures(folder / true.name), camera.size, with_stripe=True
        )
        settings = LaserSettings(name=true.name)
        found = calibrate_laser(camera, CHESSBOARD, views, settings).laser
        lasers.append(found)
        yield plane_error(truth, number, found)
    table = calibrated_table(camera, folder / 'table')
    yield axis_error(truth, table)
    found_cell = Cell(camera=camera, turntable=table.turntable, lasers=tuple(lasers))
    yield from sphere_errors(truth, found_cell)


def render(cell: Cell, folder: Path) -> None:
    rng = np.random.default_rng(5)
    jobs = []
    for k, pose in enumerate(scatter_poses(cell, CHESSBOARD, CAMERA_VIEWS, rng, tilt=1.0)):
        jobs.append((folder / 'camera' / f'{k}.png', render_board, (cell, CHESSBOARD, pose), 100))
    for number, laser in enumerate(cell.lasers):
        for k, pose in enumerate(scatter_poses(cell, CHESSBOARD, LASER_VIEWS, rng)):
            what = (cell, CHESSBOARD, pose, number)
            jobs.append((folder / laser.name / f'{k}.png', render_board, what, 200 + 50 * number))
    for k in range(TABLE_VIEWS):
        what = (cell, CHARUCO, 2 * np.pi * k / TABLE_VIEWS)
        jobs.append((folder / 'table' / f'{k}.png', render_platter_board, what, 400))
    for path, *_ in jobs:
        path.parent.mkdir(exist_ok=True)

    def draw(job: tuple) -> None:
        path, function, what, seed = job
        noise = np.random.default_rng(seed + int(path.stem))
        cv2.imwrite(str(path), function(*what, rng=noise))

    with ThreadPoolExecutor(2) as threads:
        list(threads.map(draw, jobs))


def calibrated_table(camera: Camera, folder: Path) -> TurntableCalibration:
    views = detect_targets(camera, CHARUCO, list_pictures(folder))
    first, _ = estimate_axis(camera, views, str(folder))
    return calibrate_turntable(camera, views, first)


def plane_error(truth: Cell, number: int, found: LaserPlane) -> Number:
    azimuth = list(LASER_AZIMUTHS.values())[number]
    r, z = np.meshgrid(np.linspace(-0.06, 0.06, 13), np.linspace(0.0, 0.1, 11))
    base = np.stack([r * np.cos(azimuth), r * np.sin(azimuth), z], axis=-1).reshape(-1, 3)
    points = transforms.apply(truth.turntable.camera_from_base, base)
    off = np.abs(found.distance(points))
    design = np.column_stack([points, np.ones(len(points))])
    claimed = np.sqrt(np.einsum('ni,ij,nj->n', design, found.covariance, design))
    note = f'{np.sqrt(np.mean((off / claimed) ** 2)):.1f} claimed sigmas (camera known)'
    name = f'laser plane {found.name}, worst in the volume'
    return Number(name, float(off.max()) * 1e3, 'mm', at_most(0.03), note)


def axis_error(truth: Cell, table: TurntableCalibration) -> Number:
    found, true = table.turntable.camera_from_base, truth.turntable.camera_from_base
    heights = np.linspace(0.0, 0.1, 11)[:, None]
    apart = (found[:3, 3] + heights * found[:3, 2]) - (true[:3, 3] + heights * true[:3, 2])
    up = true[:3, 2]
    across = apart - np.outer(apart @ up, up)
    worst = float(np.linalg.norm(across, axis=1).max())
    moved = transforms.invert(true) @ found
    claimed = np.sqrt(np.diag(table.adjusted.covariance))
    seen = np.array([-moved[1, 2], moved[0, 2], *moved[:2, 3]])
    ratio = float(np.sqrt(np.mean((seen / claimed[:4]) ** 2)))
    note = f'{ratio:.1f} claimed sigmas (camera known)'
    return Number('table axis, worst in the volume', worst * 1e3, 'mm', at_most(0.05), note)


def sphere_errors(truth: Cell, found: Cell) -> Iterator[Number]:
    """A 50 mm sphere on the axis, its exact stripes put into space by the found cell."""
    center = np.array([0.0, 0.0, 0.03 + SPHERE])
    for name, lasers in (
        *((laser.name, [k]) for k, laser in enumerate(truth.lasers)),
        ('both lasers', [0, 1]),
    ):
        points = np.concatenate(
            [
                scanned_sphere(truth, found, center, laser, angle)
                for laser in lasers
                for angle in np.linspace(0, 2 * np.pi, 60, endpoint=False)
            ]
        )
        radius = fitted_radius(points)
        error = 2e3 * (radius - SPHERE)
        yield Number(f'50 mm sphere, diameter error, {name}', error, 'mm')


def scanned_sphere(truth: Cell, found: Cell, center: Floats, laser: int, angle: float) -> Floats:
    """Return where the cell finds points of the sphere that camera and laser see."""
    plane = truth.lasers[laser]
    middle = truth.turntable.to_camera(center[None], angle)[0]
    off = float(plane.distance(middle[None])[0])
    foot, radius = middle - off * plane.normal, np.sqrt(SPHERE**2 - off**2)
    towards = -foot + (foot @ plane.normal) * plane.normal
    towards /= np.linalg.norm(towards)
    side = np.cross(plane.normal, towards)
    turn = np.linspace(-1.2, 1.2, 60)[:, None]
    circle = foot + radius * (np.cos(turn) * towards + np.sin(turn) * side)
    rays = found.camera.rays(truth.camera.project(circle))
    return found.turntable.to_part(found.lasers[laser].intersect(rays), angle)


def fitted_radius(points: Floats) -> float:
    def off(x: Floats) -> Floats:
        return np.linalg.norm(points - x[:3], axis=1) - x[3]

    return float(least_squares(off, [*points.mean(axis=0), SPHERE]).x[3])


def real(data: Path) -> Iterator[Number]:
    board = parse_board('chessboard:8x6:40mm')
    folders = [data / 'chessboard', data / 'chessboard_laser']
    result = real_camera(board, folders)
    note = f'{len(result.used)} of {len(result.used) + len(result.dropped)} views'
    yield Number('real camera rms', result.rms, 'px', at_most(0.20), note)
    camera = result.camera
    views = find_views(board, list_pictures(folders[1]), camera.size, with_stripe=True)
    laser = calibrate_laser(camera, board, views)
    note = f'{len(laser.used)} views, {laser.inlier_fraction:.0%} of their points'
    rms = laser.laser.residual_rms * 1e3
    yield Number('real laser plane, inlier rms', rms, 'mm', at_most(0.30), note)
    markers, pictures = parse_markers('DICT_4X4_50:30mm'), list_pictures(data / 'empty_table')
    seen = detect_targets(camera, markers, pictures)
    first, _ = estimate_axis(camera, seen, 'empty_table')
    radius = first.axis.radius(seen.observations)
    stripes = find_platter_stripes(camera, laser.laser, first.axis, radius, pictures, markers)
    table = calibrate_turntable(camera, seen, first, stripes)
    note = f"{len(stripes.uv)} points; markers / 30 mm = {table.scale:.4f} by the laser's scale"
    rms = 1e3 * (table.platter_rms or float('nan'))
    yield Number('real platter, stripe to plane rms', rms, 'mm', at_most(0.45), note)


def real_camera(board: object, folders: list[Path]) -> CameraCalibration:
    pictures = [path for folder in folders for path in list_pictures(folder)]
    return calibrate_camera(board, find_views(board, pictures))
