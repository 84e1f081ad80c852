# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Profile of the light sheet over a pixel, and the noise model of the sensor."""

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

WHITE = 255  # DN, saturation of an 8-bit sensor

# Sigmas from the laser plane beyond which there is no light: of 180 DN, 0.0007 DN are left.
SHEET_EXTENT = 5.0


@dataclass(frozen=True, kw_only=True)
class Optics:
    """
    Illumination and sensor. Gray values (DN) are linear in the light.

    A pixel with the laser signal I on top of the steady light B has the variance
    read_noise^2 + (B + I) / electrons_per_dn + (speckle I)^2, independently of its neighbors.

    stripe_sigma : pixels, of the stripe on a surface that faces the camera at the axis
    peak : DN above ambient at the center of the stripe on a white surface that faces the laser
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
        """Return the same optics without noise (gray values are still rounded)."""
        return replace(self, read_noise=0.0, electrons_per_dn=math.inf, speckle=0.0)


def sheet_sigma(cell: Cell, laser: LaserPlane, optics: Optics) -> float:
    """Return the thickness of the light sheet, 1 sigma in meters, for ``optics.stripe_sigma``."""
    across = 0 if laser.stripe == 'rows' else 1
    pixel = axis_depth(cell) / cell.camera.K[across, across]
    slant = max(abs(float(laser.normal[across])), 0.1)
    return float(optics.stripe_sigma * pixel * slant)


def with_sheet_thickness(cell: Cell, optics: Optics) -> Cell:
    """Return the cell with ``LaserPlane.thickness`` as simulated."""
    lasers = tuple(
        replace(laser, thickness=sheet_sigma(cell, laser, optics)) for laser in cell.lasers
    )
    return replace(cell, lasers=lasers)


def axis_depth(cell: Cell) -> float:
    """Return the depth in meters of the point of the table axis nearest to the optical axis."""
    direction, origin = cell.turntable.camera_from_base[:3, 2:].T
    level = direction[:2] @ direction[:2]
    along = -(direction[:2] @ origin[:2]) / level if level > 1e-6 else 0.0
    depth = origin[2] + along * direction[2]
    return float(depth if depth > 0 else origin[2])


def stripe_profile(distance: Floats, footprint: Floats, sigma: float) -> Floats:
    """
    Return the mean over each pixel of the light sheet's Gaussian profile of peak 1.

    distance : (n,) meters, signed, of the pixel's center from the laser plane
    footprint : (n,) meters, change of the distance over the pixel
    sigma : meters, 1 sigma of the light sheet
    """
    # a narrower window loses digits in the difference, without an effect on the mean
    half = np.maximum(np.abs(footprint), 1e-3 * sigma) / (2 * sigma)
    middle = distance / sigma
    mean = (ndtr(middle + half) - ndtr(middle - half)) * math.sqrt(2 * math.pi) / (2 * half)
    return np.where(np.abs(middle) < SHEET_EXTENT, mean, 0.0)


def expose(
    steady: Singles | float,
    laser: Singles,
    optics: Optics,
    rng: np.random.Generator,
) -> NDArray[np.uint8]:
    """
    Return the gray values of the sensor: speckle, shot noise, read noise, rounding.

    steady : (height, width) or one number, DN, light without speckle
    laser : (height, width) float32, DN, laser light
    returns : (height, width) uint8
    """
    signal = steady + add_speckle(laser, optics.speckle, rng)
    variance = np.float32(optics.read_noise**2) + signal * np.float32(1 / optics.electrons_per_dn)
    if optics.read_noise or math.isfinite(optics.electrons_per_dn):
        signal += np.sqrt(variance) * rng.standard_normal(laser.shape, dtype=np.float32)
    return np.asarray(np.clip(np.rint(signal), 0, WHITE).astype(np.uint8))


def add_speckle(laser: Singles, contrast: float, rng: np.random.Generator) -> Singles:
    """Return laser light (any shape, DN) with gamma-distributed speckle of the same mean."""
    if not contrast:
        return laser.copy()
    grains = 1 / contrast**2
    lit = np.flatnonzero(laser)
    result = laser.copy()
    result.flat[lit] *= rng.standard_gamma(grains, len(lit)).astype(np.float32) / grains
    return result
