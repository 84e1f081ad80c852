# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Machined parts with concave corners, holes, grooves, facing walls and fillets."""

from functools import cache

import numpy as np

from ivfmc_ros.simulation.parts.loading import Solid
from ivfmc_ros.simulation.parts.prism import arc
from ivfmc_ros.simulation.parts.prism import circle
from ivfmc_ros.simulation.parts.prism import Layer
from ivfmc_ros.simulation.parts.prism import polyline
from ivfmc_ros.simulation.parts.prism import stack

_FILLET_LAYERS = 12  # of a quarter of a circle; a chord is 9 um from a fillet of 4 mm


@cache
def flange() -> Solid:
    """Development: a flange with a hub and a bore, five bolt holes, a sharp concave corner."""
    bolts = [circle(0.004, place)[::-1] for place in _around(5, 0.037)]
    bore = circle(0.009)[::-1]
    return stack(
        [
            Layer(low=0.0, high=0.012, bottom=[circle(0.047), *bolts]),
            Layer(low=0.012, high=0.030, bottom=[circle(0.024)]),
            Layer(low=0.030, high=0.042, bottom=[circle(0.024), bore]),
        ]
    )


@cache
def channel() -> Solid:
    """Development: a block with a channel of facing walls 18 mm apart, a groove and a step."""
    base = _rectangle(-0.036, 0.036, -0.030, 0.030)
    groove = _rectangle(-0.020, 0.020, 0.019, 0.023)[::-1]
    left, right = (
        _rectangle(-0.036, -0.009, -0.030, 0.012),
        _rectangle(0.009, 0.036, -0.030, 0.012),
    )
    high = _rectangle(-0.036, -0.022, -0.030, 0.012)
    return stack(
        [
            Layer(low=0.0, high=0.010, bottom=[base]),
            Layer(low=0.010, high=0.013, bottom=[base, groove]),
            Layer(low=0.013, high=0.028, bottom=[left, right]),
            Layer(low=0.028, high=0.036, bottom=[high]),
        ]
    )


@cache
def gland() -> Solid:
    """Held: a flange whose hub rises from a fillet of 4 mm, with a turned groove and a bore."""
    bolts = [circle(0.0045, place)[::-1] for place in _around(4, 0.036, 0.4)]
    bore = circle(0.012)[::-1]
    foot, layers = 0.010, [Layer(low=0.0, high=0.010, bottom=[circle(0.045), *bolts])]
    radius, hub = 0.004, 0.021
    angles = np.linspace(0.0, np.pi / 2, _FILLET_LAYERS + 1)
    rises, reaches = radius * (1 - np.cos(angles)), hub + radius * (1 - np.sin(angles))
    unit = circle(1.0)[:: max(1, len(circle(1.0)) // 512)]
    layers += [
        Layer(
            low=foot + rises[k],
            high=foot + rises[k + 1],
            bottom=[unit * reaches[k]],
            top=[unit * reaches[k + 1]],
        )
        for k in range(_FILLET_LAYERS)
    ]
    top = foot + radius
    return stack(
        [
            *layers,
            Layer(low=top, high=0.024, bottom=[unit * hub]),
            Layer(low=0.024, high=0.029, bottom=[circle(0.017)]),
            Layer(low=0.029, high=0.034, bottom=[unit * hub]),
            Layer(low=0.034, high=0.044, bottom=[unit * hub, bore]),
        ]
    )


@cache
def bracket() -> Solid:
    """Held: an angle of two walls on a plate, with a pocket of round corners and a blind hole."""
    plate = _rectangle(-0.034, 0.034, -0.032, 0.032)
    pocket = _rounded(-0.004, 0.028, -0.026, 0.004, 0.005)[::-1]
    hole = circle(0.006, (-0.014, -0.022))[::-1]
    walls = polyline(
        (-0.034, -0.010),
        (-0.022, -0.010),
        (-0.022, 0.016),
        (0.034, 0.016),
        (0.034, 0.032),
        (-0.034, 0.032),
        (-0.034, -0.010),
    )
    return stack(
        [
            Layer(low=0.0, high=0.006, bottom=[plate]),
            Layer(low=0.006, high=0.015, bottom=[plate, pocket, hole]),
            Layer(low=0.015, high=0.037, bottom=[walls]),
        ]
    )


def _around(count: int, radius: float, first: float = 0.0) -> list[list[float]]:
    angles = first + 2 * np.pi * np.arange(count) / count
    places: list[list[float]] = (radius * np.stack([np.cos(angles), np.sin(angles)], 1)).tolist()
    return places


def _rectangle(left: float, right: float, front: float, back: float) -> np.ndarray:
    return polyline((left, front), (right, front), (right, back), (left, back), (left, front))


def _rounded(left: float, right: float, front: float, back: float, radius: float) -> np.ndarray:
    quarter = np.pi / 2
    corners = (
        (right - radius, front + radius, -quarter),
        (right - radius, back - radius, 0.0),
        (left + radius, back - radius, quarter),
        (left + radius, front + radius, 2 * quarter),
    )
    return np.concatenate(
        [
            piece
            for x, y, start in corners
            for piece in (
                arc(radius, start, start + quarter, (x, y)),
                (np.array([x, y]) + radius * _direction(start + quarter))[None],
            )
        ]
    )


def _direction(angle: float) -> np.ndarray:
    return np.array([np.cos(angle), np.sin(angle)])
