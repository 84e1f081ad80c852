# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The face of a slab at many angles, widths and brightnesses: are the claimed sigmas true?"""

from collections import defaultdict
from dataclasses import replace

import numpy as np

from ivfmc_ros.model import Frame
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.bench import LASER_AZIMUTHS
from ivfmc_ros.simulation.parts.prism import Layer
from ivfmc_ros.simulation.parts.prism import stack
from ivfmc_ros.simulation.render.optics import expose
from ivfmc_ros.simulation.render.optics import Optics
from ivfmc_ros.simulation.render.renderer import StripeRenderer
from ivfmc_ros.stripe.extract import extract
from ivfmc_ros.stripe.extract import ExtractSettings
from ivfmc_ros.stripe.noise import SensorNoise
from ivfmc_ros.stripe.triangulate import triangulate

DEEP, WIDE, HIGH = 0.008, 0.035, 0.05  # meters: half, half and whole of the slab
PEAKS = (180.0, 80.0, 30.0)
SIGMAS = (1.2, 2.5, 4.0)
INCIDENCES = np.radians([5.0, 25.0, 45.0, 60.0, 70.0])  # of the laser on the face
DRAWS = 2
LEAST = 500  # points that tell a standard deviation to 3 %
_MARGIN = 0.004  # meters from the block's edges

BINS = {
    'width': ((0, 1.5), (1.5, 3), (3, 5), (5, np.inf)),
    'height': ((0, 25), (25, 50), (50, 100), (100, np.inf)),
}


def scores():
    """Return errors over claimed sigmas of points on the faces, by bin; signed, in 3-D."""
    found = defaultdict(list)
    cell = bench_cell()
    slab = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * (DEEP, WIDE)
    solid = stack([Layer(low=0.0, high=HIGH, bottom=[slab])])
    rng = np.random.default_rng(11)
    for sigma in SIGMAS:
        optics = Optics(stripe_sigma=sigma)
        renderer = StripeRenderer(cell=cell, solid=solid, optics=optics)
        for incidence in INCIDENCES:
            for side in (-1, 1):
                angle = LASER_AZIMUTHS['left'] + side * incidence
                light = renderer.light(angle, 0)
                for peak in np.repeat(PEAKS, DRAWS):
                    dimmed = (light * (peak / optics.peak)).astype(np.float32)
                    frame = Frame(image=expose(6.0, dimmed, optics, rng), stamp_ns=0, angle=angle)
                    _add(found, cell, frame, incidence, optics)
    scores = {name: np.concatenate(parts) for name, parts in found.items()}
    return {name: values for name, values in scores.items() if len(values) >= LEAST}


def _add(found, cell, frame, incidence, optics):
    noise = SensorNoise(
        read=np.sqrt(optics.read_noise**2 + 1 / 12),
        electrons_per_dn=optics.electrons_per_dn,
        speckle=optics.speckle,
    )
    stripe = extract(frame.image, settings=ExtractSettings(noise=noise))
    profile = triangulate(cell, frame, stripe)
    x, y, z = profile.points_xyz.T
    # the front face is x = DEEP; a point's error lies along dX/du, in the sheet
    face = (np.abs(x - DEEP) < 0.002) & (np.abs(y) < WIDE - _MARGIN)
    face &= (z > _MARGIN) & (z < HIGH - _MARGIN)
    probe = triangulate(cell, frame, _shifted(stripe))
    way = probe.points_xyz[:, 0] - x
    pace = np.linalg.norm(probe.points_xyz - profile.points_xyz, axis=1)
    score = ((x - DEEP) / (way / pace) / profile.sigma)[face]
    width, height = stripe.width[face], stripe.intensity[face]
    for name, values in (('width', width), ('height', height)):
        for low, high in BINS[name]:
            chosen = (values >= low) & (values < high)
            unit = 'px' if name == 'width' else 'DN'
            found[f'{name} {low} to {high} {unit}'].append(score[chosen])
    found[f'incidence {np.degrees(incidence):.0f} degrees'].append(score)


def _shifted(stripe):
    return replace(stripe, uv=stripe.uv + np.array([0.1, 0.0]))
