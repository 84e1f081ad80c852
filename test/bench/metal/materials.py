# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Reflection of the materials, as Mitsuba describes it (GGX microfacets; red light of 650 nm).

Indices of refraction: refractiveindex.info (aluminium: Rakic 1998, iron: Johnson and Christy 1974,
copper for brass with less reflectance: Johnson and Christy 1972).
"""

from typing import Any

import numpy as np

from ivfmc_ros.model import Floats

# Translucent plastic is white plastic whose light spreads in the picture: a share of it leaves the
# surface about this far from where it entered (pixels, scale of an exponential).
TRANSLUCENT = 'translucent plastic'
SPREAD_SHARE, SPREAD_PIXELS = 0.6, 7.0


def _metal(eta: float, k: float, share: float = 1.0, **roughness: Any) -> dict[str, Any]:
    return {
        'type': 'roughconductor',
        'distribution': 'ggx',
        'eta': eta,
        'k': k,
        'specular_reflectance': share,
        **roughness,
    }


def _plastic(diffuse: float, alpha: float) -> dict[str, Any]:
    return {
        'type': 'roughplastic',
        'distribution': 'ggx',
        'int_ior': 1.5,
        'alpha': alpha,
        'diffuse_reflectance': diffuse,
    }


MATERIALS = {
    'rough aluminium': _metal(1.49, 7.8, alpha=0.32),
    'smooth aluminium': _metal(1.49, 7.8, alpha=0.10),
    'ground steel': _metal(2.9, 3.1, alpha_u=0.14, alpha_v=0.36),
    'brass': _metal(0.44, 3.3, 0.85, alpha=0.25),
    'black anodised': _plastic(0.03, 0.30),
    'white plastic': _plastic(0.75, 0.30),
    TRANSLUCENT: _plastic(0.65, 0.25),
}


def grain_directions(normals: Floats) -> Floats:
    """Return the direction of the marks of grinding on faces of these normals, (n, 3) unit."""
    level = np.abs(normals[:, 2]) > 0.7
    along = np.where(level[:, None], (1.0, 0.0, 0.0), np.cross((0.0, 0.0, 1.0), normals))
    along = along - (along * normals).sum(axis=1, keepdims=True) * normals
    return np.asarray(along / np.linalg.norm(along, axis=1, keepdims=True))
