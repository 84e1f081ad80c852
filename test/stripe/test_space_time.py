# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
from support.synthetic import draw_stripe
from support.synthetic import expose
from support.synthetic import small_cell
from support.synthetic import Sphere

from ivfmc_ros.model import Frame
from ivfmc_ros.stripe.extract import extract
from ivfmc_ros.stripe.extract import ExtractSettings
from ivfmc_ros.stripe.noise import SensorNoise
from ivfmc_ros.stripe.space_time import space_time_profile
from ivfmc_ros.stripe.triangulate import triangulate

CELL = small_cell()
SPHERE = Sphere(np.array([0.02, 0.012, 0.045]), 0.02)
STEP = np.radians(0.2)
HALF = 7
QUIET = ExtractSettings(noise=SensorNoise(speckle=0.0), max_error=50.0, shape_uncertainty=False)


def pinhole_rays():
    """Rays of all pixels at unit depth, (h, w, 3); the cell's lens has no distortion."""
    columns, rows = np.meshgrid(np.arange(640.0), np.arange(512.0))
    return np.dstack([(columns - 319.5) / 1175.0, (rows - 255.5) / 1175.0, np.ones((512, 640))])


RAYS = pinhole_rays()


def sweep(black_from=None):
    """Pictures of the sphere as it turns a little; black on the side of a plane through it."""
    frames = []
    for seq in range(2 * HALF + 1):
        angle = (seq - HALF) * STEP
        light = draw_stripe(SPHERE.stripe(CELL, angle)) - 6.0
        if black_from is not None:
            lit = light > 0.01
            light[lit] *= albedo(RAYS[lit], angle, black_from)
        rng = np.random.default_rng(seq)
        frames.append(Frame(image=expose(light + 6.0, rng), stamp_ns=seq, angle=angle, seq=seq))
    return frames


def albedo(rays, angle, azimuth):
    """What rays (n, 3) see of a sphere that is black beyond a meridian."""
    center = CELL.turntable.to_camera(SPHERE.center[None], angle)[0]
    along, length = rays @ center, (rays**2).sum(axis=1)
    root = along**2 - length * (center @ center - SPHERE.radius**2)
    depth = (along - np.sqrt(np.maximum(root, 0.0))) / length
    points = CELL.turntable.to_part(rays * depth[:, None], angle)
    x, y, _ = (points - SPHERE.center).T
    return np.where(np.arctan2(y, x) > azimuth, 0.15, 1.0)


def rms(profile):
    return np.sqrt(np.mean(SPHERE.distance(profile.points_xyz) ** 2))


def test_points_are_as_good_as_from_one_picture_and_know_it():
    frames = sweep()
    stripe = extract(frames[HALF].image, settings=QUIET)
    alone = triangulate(CELL, frames[HALF], stripe)
    together = space_time_profile(CELL, frames, HALF, stripe, QUIET)
    assert len(together) > 0.8 * len(alone)
    # a coarse cell: 0.35 mm a pixel; the ends of the stripe leave the sheet within the sweep
    middle = np.abs(together.points_xyz[:, 2] - SPHERE.center[2]) < 0.012
    distance = SPHERE.distance(together.points_xyz)[middle]
    assert np.sqrt(np.mean(distance**2)) < 0.06e-3
    assert (together.sigma > 0).all()


def test_change_of_color_moves_points_less():
    lit = SPHERE.stripe(CELL, 0.0)
    rays = CELL.camera.rays(lit)
    points = CELL.turntable.to_part(CELL.lasers[0].intersect(rays), 0.0) - SPHERE.center
    border = float(np.median(np.arctan2(points[:, 1], points[:, 0])))
    frames = sweep(border)
    stripe = extract(frames[HALF].image, settings=QUIET)
    alone = triangulate(CELL, frames[HALF], stripe)
    together = space_time_profile(CELL, frames, HALF, stripe, QUIET)
    assert len(together) > 20
    assert rms(together) < 0.6 * rms(alone)


def test_no_stripe_gives_an_empty_profile():
    frames = sweep()
    dark = [replace(frame, image=np.full_like(frame.image, 6)) for frame in frames]
    stripe = extract(dark[HALF].image, settings=QUIET)
    assert len(space_time_profile(CELL, dark, HALF, stripe, QUIET)) == 0
