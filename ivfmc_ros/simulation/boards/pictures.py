# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rendered pictures of a calibration board, free or on the platter, with or without the stripe."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import Floats
from ivfmc_ros.simulation.boards import plane_renderer
from ivfmc_ros.simulation.boards.textures import board_texture
from ivfmc_ros.simulation.boards.textures import Texture
from ivfmc_ros.simulation.parts.loading import Platter
from ivfmc_ros.simulation.render.optics import axis_depth
from ivfmc_ros.simulation.render.optics import expose
from ivfmc_ros.simulation.render.optics import Optics
from ivfmc_ros.simulation.render.optics import sheet_sigma
from ivfmc_ros.simulation.render.sources import default_source
from ivfmc_ros.simulation.render.sources import LaserSource

# Gray value (DN) of white paper: without the stripe, and with a stripe that must not saturate.
PLAIN_LEVEL = 150.0
STRIPE_LEVEL = 40.0

_TEXELS_PER_PIXEL = 2.0  # at the depth of the axis
_MARGIN = 0.5  # squares of white paper around the print

# The z axis of a board points into the print: on the platter it points down.
_FACE_UP = transforms.rigid(np.diag([1.0, -1.0, -1.0]), np.zeros(3))


@dataclass(frozen=True, eq=False, kw_only=True)
class Surroundings:
    """
    Illumination and surroundings of a board.

    level : gray value (DN) of white paper in ambient light; None: PLAIN_LEVEL or STRIPE_LEVEL
    source : position of the laser; None: ``default_source``
    platter : the disc under a board on the table, or None
    """

    level: float | None = None
    source: LaserSource | None = None
    platter: Platter | None = None


def render_board(
    cell: Cell,
    board: Board,
    camera_from_board: Floats,
    laser: int | None = None,
    *,
    optics: Optics | None = None,
    rng: np.random.Generator | None = None,
    surroundings: Surroundings | None = None,
) -> NDArray[np.uint8]:
    """
    Return a picture of a board in front of a dark background.

    camera_from_board : (4, 4) rigid, meters; z points away from the printed side
    laser : index in the cell of the laser that is on, or None
    rng : of the noise; None: seed 0
    returns : (height, width) uint8

    :raises GeometryError: the camera is behind the board
    """
    optics, surroundings = optics or Optics(), surroundings or Surroundings()
    texture = board_texture(board, _texel(cell), _MARGIN * board.square)
    light = plane_renderer.composite(
        plane_renderer.ambient_light(cell.camera, optics.ambient),
        cell.camera,
        texture,
        camera_from_board,
        level=_level(surroundings, laser),
        beam=_light_beam(cell, laser, optics, surroundings),
    )
    return expose(light.steady, light.laser, optics, rng or np.random.default_rng(0))


def render_platter_board(
    cell: Cell,
    board: Board,
    angle: float,
    laser: int | None = None,
    *,
    thickness: float = 0.0,
    optics: Optics | None = None,
    rng: np.random.Generator | None = None,
    surroundings: Surroundings | None = None,
) -> NDArray[np.uint8]:
    """
    Return a picture of a board that lies on the platter, centered on the axis.

    angle : table position, radians
    thickness : meters, of the board; its sides and its shadow are not drawn
    others : as ``render_board``
    returns : (height, width) uint8
    """
    optics, surroundings = optics or Optics(), surroundings or Surroundings()
    pose = platter_board_pose(cell, board, angle, thickness)
    layers = [(board_texture(board, _texel(cell), _MARGIN * board.square), pose)]
    if surroundings.platter is not None:
        disc = cell.turntable.camera_from_base @ _FACE_UP
        layers.insert(0, (_disc_texture(surroundings.platter), disc))
    light = plane_renderer.ambient_light(cell.camera, optics.ambient)
    beam, level = _light_beam(cell, laser, optics, surroundings), _level(surroundings, laser)
    for texture, layer_pose in layers:
        light = plane_renderer.composite(
            light, cell.camera, texture, layer_pose, level=level, beam=beam
        )
    return expose(light.steady, light.laser, optics, rng or np.random.default_rng(0))


def render_platter(
    cell: Cell,
    platter: Platter,
    laser: int | None = None,
    *,
    optics: Optics | None = None,
    rng: np.random.Generator | None = None,
    surroundings: Surroundings | None = None,
) -> NDArray[np.uint8]:
    """
    Return a picture of the bare platter, which looks the same at every table angle.

    others : as ``render_board``
    returns : (height, width) uint8
    """
    optics, surroundings = optics or Optics(), surroundings or Surroundings()
    light = plane_renderer.composite(
        plane_renderer.ambient_light(cell.camera, optics.ambient),
        cell.camera,
        _disc_texture(platter),
        cell.turntable.camera_from_base @ _FACE_UP,
        level=_level(surroundings, laser),
        beam=_light_beam(cell, laser, optics, surroundings),
    )
    return expose(light.steady, light.laser, optics, rng or np.random.default_rng(0))


def platter_board_pose(cell: Cell, board: Board, angle: float, thickness: float = 0.0) -> Floats:
    """Return the (4, 4) camera_from_board of a board on the platter at a table angle."""
    turn = transforms.rigid(transforms.rotation_z(angle), (0.0, 0.0, thickness))
    centered = transforms.rigid(np.eye(3), -board.corners_xyz.mean(axis=0))
    return np.asarray(cell.turntable.camera_from_base @ turn @ _FACE_UP @ centered)


def scatter_poses(
    cell: Cell, board: Board, count: int, rng: np.random.Generator, tilt: float = 0.6
) -> list[Floats]:
    """
    Return ``count`` random poses with the whole board in view, over picture and volume.

    tilt : radians, greatest angle of the board from facing the camera
    returns : (4, 4) camera_from_board each

    :raises GeometryError: the board does not fit into the picture
    """
    poses: list[Floats] = []
    for _ in range(200 * count):
        pose = _random_pose(cell, board, rng, tilt)
        if _is_fully_visible(cell, board, pose):
            poses.append(pose)
        if len(poses) == count:
            return poses
    raise GeometryError(f'{board} does not fit into the picture; use a smaller board')


def _random_pose(cell: Cell, board: Board, rng: np.random.Generator, tilt: float) -> Floats:
    depth = axis_depth(cell) * rng.uniform(0.8, 1.15)
    aim = rng.uniform(0.1, 0.9, 2) * cell.camera.size
    place = cell.camera.rays(aim)[0] * depth
    axis = rng.standard_normal(3) * (1.0, 1.0, 0.3)
    axis *= rng.uniform(0.3, 1.0) * tilt / np.linalg.norm(axis)
    turn = np.asarray(cv2.Rodrigues(axis)[0], dtype=np.float64)
    middle = board.corners_xyz.mean(axis=0)
    return transforms.rigid(turn, place - turn @ middle)


def _is_fully_visible(cell: Cell, board: Board, pose: Floats) -> bool:
    outline = np.zeros((4, 3))
    outline[:, :2] = board_texture(board, board.square / 8, _MARGIN * board.square).outline_xy
    points = transforms.apply(pose, outline)
    if (points[:, 2] <= 0).any():
        return False
    uv = cell.camera.project(points)
    return bool((uv > 0).all() and (uv < np.array(cell.camera.size) - 1).all())


def _light_beam(
    cell: Cell, laser: int | None, optics: Optics, surroundings: Surroundings
) -> plane_renderer.LightBeam | None:
    if laser is None:
        return None
    plane = cell.lasers[laser]
    return plane_renderer.LightBeam(
        plane=plane,
        source=surroundings.source or default_source(cell, plane),
        sigma=sheet_sigma(cell, plane, optics),
        peak=optics.peak,
    )


def _level(surroundings: Surroundings, laser: int | None) -> float:
    if surroundings.level is not None:
        return surroundings.level
    return PLAIN_LEVEL if laser is None else STRIPE_LEVEL


def _texel(cell: Cell) -> float:
    """Return the side of a texel in meters, half a pixel at the depth of the axis."""
    return float(axis_depth(cell) / cell.camera.K[0, 0] / _TEXELS_PER_PIXEL)


def _disc_texture(platter: Platter) -> Texture:
    texel = platter.radius / 512
    steps = (np.arange(1024) + 0.5) * texel - platter.radius
    inside = np.hypot.outer(steps, steps) <= platter.radius
    return Texture(
        albedo=np.where(inside, platter.reflectance, 0.0).astype(np.float32),
        corner_xy=np.full(2, -platter.radius),
        texel=texel,
    )
