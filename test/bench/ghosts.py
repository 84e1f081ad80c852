# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A metal corner that reflects its own stripe, and a bright wall behind a dim part."""

from dataclasses import dataclass
from dataclasses import replace

import cv2
import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.loading import Platter
from ivfmc_ros.simulation.parts.solids import demo_part
from ivfmc_ros.simulation.render.camera_rays import pixel_rays
from ivfmc_ros.simulation.render.optics import expose
from ivfmc_ros.simulation.render.optics import Optics
from ivfmc_ros.simulation.render.optics import sheet_sigma
from ivfmc_ros.simulation.render.renderer import StripeRenderer
from ivfmc_ros.simulation.render.scene import part_from_camera
from ivfmc_ros.simulation.render.scene import Scene
from ivfmc_ros.simulation.render.sources import default_source

CELL = bench_cell(np.zeros(5))
LASER = 0
OPTICS = Optics()
RIGHT = 3.0  # pixels from the truth within which a row shows the right stripe

_COARSE = 4  # pixels between those whose reflected light is worked out
_LIT_POINTS = 300


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture, and the (rows,) columns of its true stripe, NaN where there is none or two."""

    image: np.ndarray
    truth: np.ndarray


def right_rows(rows, u, truth):
    """Return the share of the rows with a true stripe in which it was found."""
    there = np.isfinite(truth)
    found = np.full(len(truth), np.inf)
    found[rows] = u
    with np.errstate(invalid='ignore'):
        return np.mean(np.abs(found - truth)[there] < RIGHT)


@dataclass(frozen=True, eq=False)
class Metal:
    """
    Reflection of metal: a matt and a shiny part.

    matt, shiny : shares of the light that leave in all directions, and about the mirrored one
    shine : sharpness of the mirrored lobe (Phong's exponent, normalized to keep the light)
    """

    matt: float = 0.2
    shiny: float = 0.6
    shine: float = 80.0

    def reflect(self, normal, to_light, to_eye):
        """Return the light that leaves towards the eye, per unit that comes; unit vectors."""
        mirrored = 2 * (to_light @ normal)[..., None] * normal - to_light
        lobe = np.clip((mirrored * to_eye).sum(axis=-1), 0, 1) ** self.shine
        return self.matt + self.shiny * (self.shine + 2) / 2 * lobe


@dataclass(frozen=True, eq=False)
class Wall:
    """A face of the corner: a plane n.X = d in turntable_base, seen and lit from its front."""

    normal: np.ndarray
    offset: float


def corner(opening, turn, place, tilt=0.0, metal=None, seed=0):
    """
    Return the picture of a corner of two metal faces.

    opening : radians between the faces; turn : radians, where the corner looks, 0 to the camera
    place : (x, y) meters, of the edge on the platter; tilt : radians, of the edge to its side
    """
    metal = metal or Metal()
    lean = np.array(
        [
            [1.0, 0.0, 0.0],
            [0.0, np.cos(tilt), -np.sin(tilt)],
            [0.0, np.sin(tilt), np.cos(tilt)],
        ]
    )
    walls = []
    for side, sign in ((turn - opening / 2, -1), (turn + opening / 2, 1)):
        normal = lean @ np.array([np.sin(side), -np.cos(side), 0.0]) * sign
        walls.append(Wall(normal, float(normal @ (*place, 0.0))))
    rays = np.dstack([pixel_rays(CELL.camera), np.ones(CELL.camera.size[::-1])])
    points, face = _seen(walls, rays.reshape(-1, 3))
    shape = rays.shape[:2]
    distance = CELL.lasers[LASER].distance(_to_camera(points)).reshape(shape)
    face = face.reshape(shape)
    direct = _direct(walls, metal, points.reshape(*shape, 3), distance, face)
    ghost = _reflected(walls, metal, rays, face)
    # exposed so that the matt light alone, facing the laser, would be a bench stripe
    light = (OPTICS.peak / metal.matt * (direct + ghost)).astype(np.float32)
    image = expose(OPTICS.ambient, light, OPTICS, np.random.default_rng(seed))
    return Picture(image=image, truth=_crossings(distance, face, points.reshape(*shape, 3)))


def behind_part(brightness, seed=0):
    """Return a dim part with a wall behind it that carries a stripe of ``brightness`` DN."""
    optics = replace(OPTICS, reflectance=0.35)
    part, platter = demo_part(), Platter(radius=0.06)
    renderer = StripeRenderer(cell=CELL, solid=part, platter=platter, optics=optics)
    angle = 0.3 + seed
    light = renderer.light(angle, LASER)
    rays = pixel_rays(CELL.camera).reshape(-1, 2)
    rays = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)
    pose = part_from_camera(CELL.turntable.camera_from_base, angle)
    lengths, _ = Scene(part, platter, 1.0).cast(pose[:3, 3], rays @ pose[:3, :3].T)
    free = np.isinf(lengths)
    wall = _to_camera_plane(np.array([1.0, 0.0, 0.0]), -0.16)
    points = rays * (-wall[3] / (rays @ wall[:3]))[:, None]
    sigma = sheet_sigma(CELL, CELL.lasers[LASER], optics)
    bell = np.exp(-0.5 * (CELL.lasers[LASER].distance(points) / sigma) ** 2)
    light = light + (brightness * bell * free).reshape(light.shape).astype(np.float32)
    image = expose(optics.ambient, light, optics, np.random.default_rng(seed))
    truth = renderer.truth(angle, LASER)
    count = np.bincount(truth.line, minlength=len(light))
    single = count[truth.line] == 1
    columns = np.full(len(light), np.nan)
    columns[truth.line[single]] = truth.across[single]
    return Picture(image=image, truth=columns)


def _seen(walls, rays):
    """Return where rays meet the nearer face, (n, 3) meters in turntable_base, and which."""
    base = transforms.invert(CELL.turntable.camera_from_base)
    origin, directions = base[:3, 3], rays @ base[:3, :3].T
    with np.errstate(divide='ignore', invalid='ignore'):
        lengths = np.stack(
            [(wall.offset - wall.normal @ origin) / (directions @ wall.normal) for wall in walls]
        )
    lengths[lengths <= 0] = np.inf
    face = lengths.argmin(axis=0)
    nearest = lengths.min(axis=0)
    face[np.isinf(nearest)] = -1
    points = origin + np.where(np.isfinite(nearest), nearest, 10.0)[:, None] * directions
    outside = (np.hypot(points[:, 0], points[:, 1]) > 0.055) | (points[:, 2] < 0)
    face[outside | (points[:, 2] > 0.09)] = -1
    return points, face


def _direct(walls, metal, points, distance, face):
    sigma = sheet_sigma(CELL, CELL.lasers[LASER], OPTICS)
    light = np.zeros(face.shape)
    source, eye = _source(), transforms.invert(CELL.turntable.camera_from_base)[:3, 3]
    for number, wall in enumerate(walls):
        lit = (face == number) & (np.abs(distance) < 5 * sigma)
        to_light, to_eye = _unit(source - points[lit]), _unit(eye - points[lit])
        facing = np.clip(to_light @ wall.normal, 0, None)
        bell = np.exp(-0.5 * (distance[lit] / sigma) ** 2)
        light[lit] = bell * facing * metal.reflect(wall.normal, to_light, to_eye)
    return light


def _reflected(walls, metal, rays, face):
    """Return the light that the stripe on one face throws on the other, and that to the eye."""
    coarse = rays[::_COARSE, ::_COARSE].reshape(-1, 3)
    points, seen = _seen(walls, coarse)
    source, eye = _source(), transforms.invert(CELL.turntable.camera_from_base)[:3, 3]
    sigma = sheet_sigma(CELL, CELL.lasers[LASER], OPTICS)
    light = np.zeros(len(coarse))
    for number, wall in enumerate(walls):
        lit, length = _stripe_on(walls, 1 - number)
        other = walls[1 - number]
        to_source = _unit(source - lit)
        power = np.clip(to_source @ other.normal, 0, None) * length * sigma * np.sqrt(2 * np.pi)
        for index in np.array_split(np.flatnonzero(seen == number), 64):
            between = points[index][:, None] - lit
            away = np.linalg.norm(between, axis=2)
            way = between / away[..., None]
            leaves = metal.reflect(other.normal, np.broadcast_to(to_source, way.shape), way)
            leaves = leaves * np.clip(way @ other.normal, 0, None)
            meets = np.clip(-way @ wall.normal, 0, None) / np.maximum(away, 1e-3) ** 2 / np.pi
            to_eye = np.broadcast_to(_unit(eye - points[index])[:, None], way.shape)
            turned = metal.reflect(wall.normal, -way, to_eye)
            light[index] = (power * leaves * meets * turned).sum(axis=1)
    grid = light.reshape(rays[::_COARSE, ::_COARSE].shape[:2]).astype(np.float32)
    return cv2.resize(grid, face.shape[::-1], interpolation=cv2.INTER_LINEAR) * (face >= 0)


def _stripe_on(walls, number):
    """Return points of the stripe on a face, (n, 3) meters, and the length of each."""
    normal, offset = _to_base_plane(CELL.lasers[LASER])
    wall, other = walls[number], walls[1 - number]
    along = _unit(np.cross(normal, wall.normal)[None])[0]
    matrix = np.stack([normal, wall.normal, along])
    origin = np.linalg.solve(matrix, [offset, wall.offset, 0.0])
    steps = np.linspace(-0.12, 0.12, _LIT_POINTS)
    points = origin + steps[:, None] * along
    inside = (np.hypot(points[:, 0], points[:, 1]) < 0.055) & (points[:, 2] > 0)
    inside &= (points[:, 2] < 0.09) & (points @ other.normal > other.offset)
    return points[inside], steps[1] - steps[0]


def _crossings(distance, face, points):
    """Return the column at which each row crosses the sheet, NaN if not once."""
    truth = np.full(len(face), np.nan)
    same = (face[:, 1:] == face[:, :-1]) & (face[:, 1:] >= 0)
    crossed = same & (np.sign(distance[:, 1:]) != np.sign(distance[:, :-1]))
    for row in np.flatnonzero(crossed.sum(axis=1) == 1):
        column = int(crossed[row].argmax())
        a, b = distance[row, column], distance[row, column + 1]
        truth[row] = column + a / (a - b)
    return truth


def _source():
    position = default_source(CELL, CELL.lasers[LASER]).position
    return transforms.apply(transforms.invert(CELL.turntable.camera_from_base), position)


def _to_camera(points):
    return transforms.apply(CELL.turntable.camera_from_base, points)


def _to_camera_plane(normal, offset):
    """Return (4,) n, d with n.X + d = 0 in the camera's frame of n.X = offset in the base's."""
    pose = CELL.turntable.camera_from_base
    turned = pose[:3, :3] @ normal
    return np.append(turned, -offset - turned @ pose[:3, 3])


def _to_base_plane(laser):
    """Return n, d with n.X = d in turntable_base."""
    pose = CELL.turntable.camera_from_base
    return pose[:3, :3].T @ laser.normal, -laser.offset - laser.normal @ pose[:3, 3]


def _unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
