# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Option types with units: a bare number is in mm, degrees or ms."""

from collections.abc import Mapping
import math
import re
from typing import Any
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    _ParamType = click.ParamType[float]
else:
    _ParamType = click.ParamType

_NUMBER = re.compile(r'\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([^\s\d]*)\s*')
_METERS = {
    'mm': 1e-3,
    'm': 1.0,
    'cm': 1e-2,
    'um': 1e-6,
    'µm': 1e-6,
    'in': 0.0254,
    'inch': 0.0254,
}
_RADIANS = {
    'deg': math.pi / 180.0,
    '°': math.pi / 180.0,
    'rad': 1.0,
    'mrad': 1e-3,
}
_SECONDS = {
    'ms': 1e-3,
    's': 1.0,
    'us': 1e-6,
    'µs': 1e-6,
}


class Quantity(_ParamType):
    """
    A number with a unit, converted to SI.

    units : factor to SI of each unit; the first one is that of a bare number
    low, high : allowed range in SI, bounds included; a refusal states them in the typed unit
    """

    def __init__(
        self,
        name: str,
        units: Mapping[str, float],
        low: float = -math.inf,
        high: float = math.inf,
    ) -> None:
        self.name = name
        self._units = units
        self._low, self._high = low, high

    def convert(self, value: Any, param: Any, ctx: Any) -> float:
        """Return the SI value of a text; a float is an SI value already (a default)."""
        if isinstance(value, float):
            return value
        found = _NUMBER.fullmatch(str(value))
        unit = (found[2] or next(iter(self._units))) if found else ''
        if found is None or unit not in self._units:
            first = next(iter(self._units))
            self.fail(
                f'{value!r} is not {_article(self.name)}; write a number of {first}, or one with '
                f'a unit ({", ".join(self._units)})',
                param,
                ctx,
            )
        factor = self._units[unit]
        result = float(found[1]) * factor
        if not self._low <= result <= self._high:
            self.fail(f'{value} is out of range; {self._allowed(unit, factor)}', param, ctx)
        return result

    def _allowed(self, unit: str, factor: float) -> str:
        low, high = self._low / factor, self._high / factor
        if math.isinf(high):
            return f'it must be at least {low:.6g} {unit}'
        if math.isinf(low):
            return f'it must be at most {high:.6g} {unit}'
        return f'it must be {low:.6g} to {high:.6g} {unit}'

    def get_metavar(self, param: Any, ctx: Any = None) -> str:
        """Return what ``--help`` shows: the unit of a bare number."""
        return next(iter(self._units)).upper()


def length(low: float = -math.inf, high: float = math.inf) -> Quantity:
    """Option type of a length; bounds in meters."""
    return Quantity('length', _METERS, low, high)


def angle(low: float = -math.inf, high: float = math.inf) -> Quantity:
    """Option type of an angle; bounds in radians."""
    return Quantity('angle', _RADIANS, low, high)


def duration(low: float = -math.inf, high: float = math.inf) -> Quantity:
    """Option type of a duration; bounds in seconds."""
    return Quantity('duration', _SECONDS, low, high)


def parse_angle(text: str) -> float:
    """Return an angle in radians; :raises click.BadParameter: the text is no angle."""
    return angle().convert(text, None, None)


def _article(name: str) -> str:
    return f'an {name}' if name[0] in 'aeiou' else f'a {name}'
