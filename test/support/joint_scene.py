# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Exact observations of a known cell with noise, as a joint calibration takes them."""

from dataclasses import dataclass
from dataclasses import replace

import cv2
import numpy as np

from ivfmc_ros.calibration.boards.board import Corners
from ivfmc_ros.calibration.boards.board import parse_board
from ivfmc_ros.calibration.boards.board_shape import BoardShape
from ivfmc_ros.calibration.camera.board_poses import BoardPose
from ivfmc_ros.calibration.joint.observations import BoardPicture
from ivfmc_ros.calibration.joint.observations import JointObservations
from ivfmc_ros.calibration.joint.observations import PlatterCorners
from ivfmc_ros.calibration.joint.observations import PlatterStripe
from ivfmc_ros.calibration.joint.observations import StripePixels
from ivfmc_ros.calibration.joint.parameters import apply_step
from ivfmc_ros.calibration.joint.parameters import JointState
from ivfmc_ros.calibration.joint.parameters import ParameterOrder
from ivfmc_ros.calibration.turntable.axis import AxisState
from ivfmc_ros.calibration.turntable.axis import CornerObservations
from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.model import Floats
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.boards.pictures import scatter_poses

BOARD = parse_board('chessboard:17x12:8mm')
TARGET = parse_board('charuco:10x7:12mm:9mm:DICT_4X4_50')


@dataclass(frozen=True, kw_only=True)
class SceneSettings:
    """Numbers of pictures, and noise in pixels (corner coordinates, stripe positions)."""

    boards: int = 12
    striped: int = 8  # of each laser
    turned: int = 12
    platter_stripes: int = 3  # of each laser
    corner_noise: float = 0.03
    stripe_noise: float = 0.1
    seed: int = 0


def scene(settings: SceneSettings = SceneSettings()) -> tuple[JointObservations, JointState]:
    """Return observations of the bench cell, and the true state."""
    cell, rng = bench_cell(), np.random.default_rng(settings.seed)
    poses, pictures = [], []
    groups = [(None, settings.boards), *((k, settings.striped) for k in range(len(cell.lasers)))]
    for laser, count in groups:
        for number, matrix in enumerate(scatter_poses(cell, BOARD, count, rng, tilt=1.0)):
            pose = np.concatenate([cv2.Rodrigues(matrix[:3, :3])[0].ravel(), matrix[:3, 3]])
            stripe = None if laser is None else _board_stripe(cell, laser, pose, settings, rng)
            name = f'board_{"" if laser is None else cell.lasers[laser].name}/{number}.png'
            uv = cell.camera.project(transforms.apply(matrix, BOARD.corners_xyz))
            uv = uv + settings.corner_noise * rng.standard_normal(uv.shape)
            corners = Corners(ids=np.arange(len(uv)), uv=uv)
            pictures.append(BoardPicture(name=name, corners=corners, stripe=stripe))
            poses.append(pose)
    platter, axis = _platter(cell, settings, rng)
    stripes = tuple(
        PlatterStripe(
            name=f'platter_{laser.name}/{number}.png',
            stripe=_platter_stripe(cell, index, settings, rng),
        )
        for index, laser in enumerate(cell.lasers)
        for number in range(settings.platter_stripes)
    )
    state = JointState(
        camera=cell.camera,
        board_shape=BoardShape.flat(BOARD),
        lasers=cell.lasers,
        axis=axis,
        board_poses=np.array(poses),
    )
    seen = JointObservations(
        board=BOARD, pictures=tuple(pictures), platter=platter, platter_stripes=stripes
    )
    return seen, state


def disturbed(state: JointState, seed: int = 0) -> JointState:
    """Return a state that is off as separate steps are: pixels, tenths of millimeters."""
    rng, order = np.random.default_rng(seed), ParameterOrder.of(state)
    step = np.zeros(order.count)
    step[:4] = rng.normal(0.0, 2.0, 4)
    step[1] = step[0]
    for index in range(len(state.lasers)):
        step[order.laser(index)][:3] = rng.normal(0.0, 3e-4, 3)
    step[order.axis][:5] = rng.normal(0.0, 3e-4, 5)
    poses = rng.normal(0.0, 3e-4, state.board_poses.shape)
    return apply_step(state, order, step, poses, rng.normal(0.0, 1e-3, len(state.axis.angles)))


def _board_stripe(
    cell: Cell, index: int, pose: Floats, settings: SceneSettings, rng: np.random.Generator
) -> StripePixels | None:
    """Return the stripe where plane and board meet, by rays of all rows."""
    shape = BoardShape.flat(BOARD)
    board = BoardPose(pose=pose, covariance=np.zeros((6, 6)), board_shape=shape, rms=0.0)
    laser, R = cell.lasers[index], cv2.Rodrigues(pose[:3])[0]
    along = np.cross(laser.normal, R[:, 2])
    along /= np.linalg.norm(along)
    low, high = BOARD.corners_xyz.min(axis=0), BOARD.corners_xyz.max(axis=0)
    middle = board.to_camera(0.5 * (low + high)[None])[0]
    across = np.cross(along, R[:, 2])
    foot = middle - across * (laser.distance(middle[None])[0] / (laser.normal @ across))
    points = foot + np.linspace(-0.15, 0.15, 400)[:, None] * along
    local = board.to_board(points)[:, :2]
    inside = ((local > low[:2]) & (local < high[:2])).all(axis=1)
    if inside.sum() < 40:
        return None
    return _pixels(cell, index, points[inside], settings, rng)


def _platter_stripe(
    cell: Cell, index: int, settings: SceneSettings, rng: np.random.Generator
) -> StripePixels:
    T = cell.turntable.camera_from_base
    normal = T[:3, :3].T @ cell.lasers[index].normal
    along = np.array([-normal[1], normal[0], 0.0]) / np.hypot(normal[0], normal[1])
    base = np.linspace(-0.05, 0.05, 300)[:, None] * along
    return _pixels(cell, index, transforms.apply(T, base), settings, rng)


def _pixels(
    cell: Cell, index: int, points: Floats, settings: SceneSettings, rng: np.random.Generator
) -> StripePixels:
    uv = cell.camera.project(points)
    uv[:, 0] += settings.stripe_noise * rng.standard_normal(len(uv))
    return StripePixels(laser=index, uv=uv, sigma=settings.stripe_noise)


def _platter(
    cell: Cell, settings: SceneSettings, rng: np.random.Generator
) -> tuple[PlatterCorners, AxisState]:
    local = TARGET.corners_xyz * (1.0, -1.0, 1.0)
    middle = local.mean(axis=0)
    angles = 2 * np.pi * np.arange(settings.turned) / settings.turned
    axis = AxisState(
        camera_from_base=cell.turntable.camera_from_base,
        tilt=np.zeros(2),
        scale=1.0,
        layout=np.array([[-middle[0], -middle[1], 0.0]]),
        angles=angles,
    )
    count = len(local)
    picture = np.repeat(np.arange(settings.turned), count)
    seen = CornerObservations(
        picture=picture,
        group=np.zeros_like(picture),
        corner=np.tile(np.arange(count), settings.turned),
        local_xyz=np.tile(local, (settings.turned, 1)),
        uv=np.zeros((len(picture), 2)),
        bloom_jacobian=np.zeros((len(picture), 2)),
    )
    pixels = cell.camera.project(axis.corners_in_camera(seen))
    pixels = pixels + settings.corner_noise * rng.standard_normal(pixels.shape)
    focal = cell.camera.K[[0, 1], [0, 1]]
    corners = replace(seen, uv=cell.camera.rays(pixels)[:, :2] * focal)
    names = tuple(f'platter/{number}.png' for number in range(settings.turned))
    return PlatterCorners(target=TARGET, names=names, corners=corners, pixels=pixels), axis


def laser_error(found: LaserPlane, true: LaserPlane, points: Floats) -> float:
    """Return the greatest distance in meters of points of the true plane from the found one."""
    on_plane = points - true.distance(points)[:, None] * true.normal
    return float(np.abs(found.distance(on_plane)).max())
