# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From light to grey values: the stripe's profile, and what a sensor makes of it."""

from dataclasses import dataclass
from dataclasses import replace
import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Singles
from ivfmc_ros.validation import require_in_range

WHITE = 255  # an 8-bit sensor ends here

# Beyond this many sigmas the sheet is dark: 180 DN would be 0.0007 DN there.
SHEET_EDGE = 5.0


@dataclass(frozen=True, kw_only=True)
class Optics:
    """
    Light and sensor. Grey values (DN) are linear in the light.

    A pixel that gets the laser signal I on top of its steady light B has the variance
    read_noise^2 + (B + I) / electrons_per_dn + (speckle I)^2, independently of its neighbours.

    stripe_sigma : pixels, of the stripe on a surface that faces the camera at the axis
    peak : DN above ambient at the middle of the stripe on a white surface that faces the laser
    ambient : DN everywhere
    read_noise : DN; 0 switches it off
    electrons_per_dn : shot noise; infinite switches it off
    speckle : contrast, standard deviation over mean of the laser light; 0 switches it off
    reflectance : of the part, 1 is white
    """

    stripe_sigma: float = 2.5
    peak: float = 180.0
    ambient: float = 6.0
    read_noise: float = 2.0
    electrons_per_dn: float = 45.0
    speckle: float = 0.15
    reflectance: float = 1.0

    def __post_init__(self) -> None:
        for name in ('stripe_sigma', 'electrons_per_dn'):
            require_in_range(name, getattr(self, name), 0.0, math.inf, open_low=True)
        for name in ('peak', 'ambient', 'read_noise', 'speckle', 'reflectance'):
            require_in_range(name, getattr(self, name), 0.0, math.inf, open_high=True)

    def without_noise(self) -> 'Optics':
        """Return the same light on a perfect sensor (grey values are still whole numbers)."""
        return replace(self, read_noise=0.0, electrons_per_dn=math.inf, speckle=0.0)


def sheet_sigma(cell: Cell, laser: LaserPlane, optics: Optics) -> float:
    """Return the sheet's 1 sigma thickness in metres that gives ``optics.stripe_sigma``."""
    across = 0 if laser.stripe == 'rows' else 1
    pixel = axis_depth(cell) / cell.camera.K[across, across]
    slant = max(abs(float(laser.normal[across])), 0.1)
    return float(optics.stripe_sigma * pixel * slant)


def with_thickness(cell: Cell, optics: Optics) -> Cell:
    """Return the cell with the thickness that its sheets have in the simulation."""
    lasers = tuple(
        replace(laser, thickness=sheet_sigma(cell, laser, optics)) for laser in cell.lasers
    )
    return replace(cell, lasers=lasers)


def axis_depth(cell: Cell) -> float:
    """Return the depth in metres at which the camera sees the table's axis best centred."""
    direction, origin = cell.turntable.camera_from_base[:3, 2:].T
    level = direction[:2] @ direction[:2]
    along = -(direction[:2] @ origin[:2]) / level if level > 1e-6 else 0.0
    depth = origin[2] + along * direction[2]
    return float(depth if depth > 0 else origin[2])


def stripe_profile(distance: Floats, footprint: Floats, sigma: float) -> Floats:
    """
    Return the mean of the sheet's Gaussian over a pixel, 1 at its middle.

    distance : (n,) metres, of the pixel's centre from the sheet
    footprint : (n,) metres, by how much the distance changes over the pixel
    sigma : metres, of the sheet
    """
    # A narrower window loses digits in the difference and gains none in the mean.
    half = np.maximum(np.abs(footprint), 1e-3 * sigma) / (2 * sigma)
    middle = distance / sigma
    mean = (ndtr(middle + half) - ndtr(middle - half)) * math.sqrt(2 * math.pi) / (2 * half)
    return np.where(np.abs(middle) < SHEET_EDGE, mean, 0.0)


def expose(
    steady: Singles | float,
    laser: Singles,
    optics: Optics,
    rng: np.random.Generator,
) -> NDArray[np.uint8]:
    """
    Return the picture that the sensor makes of light.

    steady : (height, width) or one number, DN, light that has no speckle
    laser : (height, width) float32, DN, laser light
    """
    signal = steady + speckled(laser, optics.speckle, rng)
    variance = np.float32(optics.read_noise**2) + signal * np.float32(1 / optics.electrons_per_dn)
    if optics.read_noise or math.isfinite(optics.electrons_per_dn):
        signal += np.sqrt(variance) * rng.standard_normal(laser.shape, dtype=np.float32)
    return np.asarray(np.clip(np.rint(signal), 0, WHITE).astype(np.uint8))


def speckled(laser: Singles, contrast: float, rng: np.random.Generator) -> Singles:
    """Return laser light (any shape, DN) with the grain of speckle, of the same mean."""
    if not contrast:
        return laser.copy()
    grains = 1 / contrast**2
    lit = np.flatnonzero(laser)
    result = laser.copy()
    result.flat[lit] *= rng.standard_gamma(grains, len(lit)).astype(np.float32) / grains
    return result
