# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A small cell and a sphere on its table, in closed form: truth for tests."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.cell import Turntable
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Image
from ivfmc_ros.model import Profile
from ivfmc_ros.simulation.bench import axial_plane
from ivfmc_ros.simulation.bench import look_at_axis

WIDTH, HEIGHT, FOCAL = 640, 512, 1175.0
LASERS = {'left': np.radians(36.0), 'right': np.radians(-30.0)}


def small_camera(**changes) -> Camera:
    values = {
        'width': WIDTH,
        'height': HEIGHT,
        'K': np.array([[FOCAL, 0, 319.5], [0, FOCAL, 255.5], [0, 0, 1.0]]),
        'distortion': np.zeros(5),
    }
    return Camera(**{**values, **changes})


def small_cell(camera: Camera | None = None) -> Cell:
    """Return the bench cell with a camera of a quarter of its pixels."""
    pose = look_at_axis(0.4, np.radians(20.0), 0.045)
    return Cell(
        camera=camera or small_camera(),
        turntable=Turntable(camera_from_base=pose),
        lasers=tuple(axial_plane(name, azimuth, pose) for name, azimuth in LASERS.items()),
    )


@dataclass(frozen=True, eq=False)
class Sphere:
    """A sphere that turns with the table; center (3,) and radius in meters, in turntable."""

    center: Floats
    radius: float

    def distance(self, points_xyz: Floats) -> Floats:
        return np.linalg.norm(points_xyz - self.center, axis=1) - self.radius

    def stripe(self, cell: Cell, angle: float, laser: int = 0) -> Floats:
        """Return where the camera (without distortion) sees the stripe, (n, 2) pixels."""
        base_from_camera = transforms.invert(cell.turntable.camera_from_base)
        rows = np.arange(cell.camera.height, dtype=np.float64)
        ends = [
            transforms.apply(base_from_camera, _on_sheet(cell, laser, column, rows))
            for column in (0.0, cell.camera.width - 1.0)
        ]
        along = ends[1] - ends[0]
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        center = transforms.rotation_z(angle) @ self.center
        from_center = ends[0] - center
        half = (along * from_center).sum(axis=1)
        root = np.sqrt(half**2 - (from_center**2).sum(axis=1) + self.radius**2 + 0j)
        found = []
        for sign in (-1.0, 1.0):
            points = ends[0] + (sign * root.real - half)[:, None] * along
            found.append(points[(root.imag == 0) & self._is_seen(cell, laser, points, center)])
        points = np.concatenate(found)
        uv = cell.camera.project(transforms.apply(cell.turntable.camera_from_base, points))
        return uv[np.argsort(uv[:, 1])]

    def _is_seen(self, cell: Cell, laser: int, points: Floats, center: Floats) -> Floats:
        eye = transforms.invert(cell.turntable.camera_from_base)[:3, 3]
        azimuth = list(LASERS.values())[laser]
        source = 0.5 * np.array([np.cos(azimuth), np.sin(azimuth), 0.6])
        normals = (points - center) / self.radius
        seen = np.ones(len(points), dtype=bool)
        for at in (eye, source):
            sight = at - points
            seen &= (sight * normals).sum(axis=1) > 0.2 * np.linalg.norm(sight, axis=1)
        return seen


def _on_sheet(cell: Cell, laser: int, column: float, rows: Floats) -> Floats:
    uv = np.stack([np.full(len(rows), column), rows], axis=1)
    return cell.lasers[laser].intersect(cell.camera.rays(uv))


def draw_stripe(
    uv: Floats,
    shape: tuple[int, int] = (HEIGHT, WIDTH),
    *,
    peak: float = 150.0,
    sigma: float = 2.5,
    ambient: float = 6.0,
) -> Floats:
    """Return (h, w) gray values without noise; uv (n, 2) with at most one point in a row."""
    light = np.full(shape, ambient)
    rows = np.round(uv[:, 1]).astype(int)
    columns = np.arange(shape[1])
    light[rows] += peak * np.exp(-0.5 * ((columns - uv[:, :1]) / sigma) ** 2)
    return light


def expose(
    light: Floats,
    rng: np.random.Generator | None = None,
    *,
    ambient: float = 6.0,
    read: float = 2.0,
    electrons_per_dn: float = 45.0,
    speckle: float = 0.0,
) -> Image:
    """Return the uint8 picture of (h, w) gray values; without rng only the rounding is noise."""
    if rng is not None:
        laser = light - ambient
        if speckle:
            light = ambient + laser * rng.gamma(speckle**-2, speckle**2, light.shape)
        deviation = np.sqrt(read**2 + light / electrons_per_dn)
        light = light + deviation * rng.standard_normal(light.shape)
    return np.clip(np.rint(light), 0, 255).astype(np.uint8)


def sphere_frames(
    cell: Cell,
    sphere: Sphere,
    steps: int,
    *,
    laser: int = 0,
    view: int = 0,
    first: int = 0,
    seed: int | None = None,
) -> list[Frame]:
    """Return the pictures of one full turn; with a seed they have noise and speckle."""
    rng = None if seed is None else np.random.default_rng(seed)
    frames = []
    for step in range(steps):
        angle = 2.0 * np.pi * step / steps
        light = draw_stripe(sphere.stripe(cell, angle, laser))
        frames.append(
            Frame(
                image=expose(light, rng, speckle=0.15),
                stamp_ns=step * 50_000_000,
                angle=angle,
                laser=laser,
                view=view,
                seq=first + step,
            )
        )
    return frames


def make_profile(
    points_xyz: Floats,
    *,
    uv: Floats | None = None,
    angle: float = 0.0,
    laser: int = 0,
    view: int = 0,
    seq: int = 0,
) -> Profile:
    points = np.asarray(points_xyz, dtype=np.float64).reshape(-1, 3)
    rows = np.arange(len(points), dtype=np.float64)
    return Profile(
        points_xyz=points,
        intensity=np.full(len(points), 100.0),
        sigma=np.full(len(points), 1e-5),
        uv=np.stack([np.zeros(len(points)), rows], axis=1) if uv is None else uv,
        angle=angle,
        laser=laser,
        view=view,
        seq=seq,
        stamp_ns=0,
    )


def sphere_profiles(
    cell: Cell,
    sphere: Sphere,
    steps: int,
    *,
    laser: int = 0,
    view: int = 0,
    turn: float = 2.0 * np.pi,
) -> list[Profile]:
    """Return the exact profiles of a sweep over ``turn`` radians, without pictures."""
    profiles = []
    for step in range(steps):
        angle = turn * step / steps
        uv = sphere.stripe(cell, angle, laser)
        points = cell.lasers[laser].intersect(cell.camera.rays(uv))
        part = cell.turntable.to_part(points, angle)
        profiles.append(make_profile(part, uv=uv, angle=angle, laser=laser, view=view, seq=step))
    return profiles
