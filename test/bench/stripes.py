# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Synthetic stripes, the least error that their pixels allow, and a chain to compare with."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.special import ndtr

from ivfmc_ros.stripe.noise import SensorNoise

WIDTH, HEIGHT = 1280, 1024
AMBIENT = 6.0
_ROUNDING = 1 / 12  # DN^2, of whole gray values


@dataclass(frozen=True)
class Case:
    """Gaussian sigma in pixels, height in DN, and the noise of the pixels."""

    sigma: float
    height: float
    read: float
    electrons_per_dn: float = np.inf
    speckle: float = 0.0

    def __str__(self):
        return f'sigma {self.sigma} px, {self.height:.0f} DN, noise {self.read:.0f} DN'

    @property
    def noise(self):
        return SensorNoise(
            read=np.sqrt(self.read**2 + _ROUNDING),
            electrons_per_dn=self.electrons_per_dn,
            speckle=self.speckle,
        )


def bell(x, sigma):
    """Return a Gaussian's mean over each pixel."""
    area = ndtr((x + 0.5) / sigma) - ndtr((x - 0.5) / sigma)
    return np.sqrt(2 * np.pi) * sigma * area


def pictures(case, count, seed, jitter=0.5) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """
    Yield pictures and the (HEIGHT,) columns of their stripes, of every sub-pixel phase.

    jitter : pixels by which rows differ from a smooth stripe, to each side
    """
    rng = np.random.default_rng(seed)
    rows = np.arange(HEIGHT)
    reach = int(np.ceil(8 * case.sigma))
    steps = np.arange(-reach, reach + 1)
    for _ in range(count):
        bow = rng.uniform(-120, 120) * np.sin(rows / 1024 * np.pi) + rng.uniform(300, 900)
        u = bow + rng.uniform(-jitter, jitter, HEIGHT)
        first = np.rint(u).astype(int)
        light = case.height * bell(first[:, None] + steps - u[:, None], case.sigma)
        if case.speckle:
            grains = case.speckle**-2
            light *= rng.gamma(grains, 1 / grains, light.shape)
        image = np.full((HEIGHT, WIDTH), AMBIENT, dtype=np.float32)
        image[rows[:, None], first[:, None] + steps] += light.astype(np.float32)
        spread = np.sqrt(case.read**2 + image / case.electrons_per_dn)
        image += spread * rng.standard_normal(image.shape, dtype=np.float32)
        yield np.clip(np.rint(image), 0, 255).astype(np.uint8), u


def bound(case):
    """
    Return the Cramer-Rao bound of a stripe's place, pixels, rms over sub-pixel phases.

    Place, height, width and ground are unknown; the noise is the picture's, its rounding to
    whole gray values left out. What the variance of the pixels tells beside their mean, under
    speckle, is left in, so that the bound is the lower of two.
    """
    variances = []
    for phase in np.arange(20) / 20:
        x = np.arange(-80, 81) - phase
        values = np.array([case.height, 0.0, case.sigma, AMBIENT])

        def model(p, x=x):
            laser = p[0] * bell(x - p[1], p[2])
            total = laser + p[3]
            variance = case.read**2 + total / case.electrons_per_dn + (case.speckle * laser) ** 2
            return np.stack([total, variance])

        steps = 1e-4 * np.maximum(np.abs(values), 1.0)
        slopes = [
            (model(values + step) - model(values - step)) / (2 * step.sum())
            for step in np.diag(steps)
        ]
        mean, spread = np.array(slopes).transpose(1, 0, 2)
        variance = model(values)[1]
        fisher = (mean / variance) @ mean.T + 0.5 * (spread / variance**2) @ spread.T
        variances.append(np.linalg.inv(fisher)[1, 1])
    return float(np.sqrt(np.mean(variances)))


def horus(image):
    """
    Find the stripe as Horus documents it: (rows, columns).

    Threshold 50, blur 5x5, threshold again, what is within 8 pixels of the brightest pixel of
    each row, center of mass, and a Gaussian of sigma 2 along each unbroken segment of rows.
    """
    lit = cv2.threshold(image, 50, 255, cv2.THRESH_TOZERO)[1]
    lit = cv2.threshold(cv2.blur(lit, (5, 5)), 50, 255, cv2.THRESH_TOZERO)[1]
    columns = np.arange(image.shape[1])
    window = np.abs(columns - lit.argmax(axis=1)[:, None]) <= 8
    lit = lit * window
    total = lit.sum(axis=1)
    rows = np.flatnonzero(total)
    u = (lit[rows] @ columns.astype(np.float64)) / total[rows]
    breaks = np.flatnonzero((np.diff(rows) > 1) | (np.abs(np.diff(u)) > 4)) + 1
    parts = [gaussian_filter(part, 2.0) for part in np.split(u, breaks) if len(part)]
    return rows, np.concatenate(parts) if parts else u
