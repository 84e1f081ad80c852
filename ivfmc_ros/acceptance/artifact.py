# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Calibrated artifacts: sphere, ball bar, plate and gauge step, with their uncertainties."""

from dataclasses import dataclass
import re

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.validation import require_in_range
from ivfmc_ros.validation import require_one_of

KINDS = ('sphere', 'ball_bar', 'plate', 'gauge_step')
SYNTAX = "'sphere:25.002mm', 'ball_bar:20.001mm:99.998mm', 'plate', 'gauge_step:10.0005mm'"
# Number of lengths after the name of each kind.
_LENGTHS = {'sphere': 1, 'ball_bar': 2, 'plate': 0, 'gauge_step': 1}
_LENGTH = re.compile(r'([0-9]*\.?[0-9]+)\s*(mm|um|m|in)?')
_UNITS = {None: 1e-3, 'mm': 1e-3, 'um': 1e-6, 'm': 1.0, 'in': 0.0254}
# Lengths in meters that an artifact of a laser stripe can have.
_MIN_LENGTH, _MAX_LENGTH = 1e-4, 2.0


@dataclass(frozen=True, kw_only=True)
class Artifact:
    """
    A calibrated artifact. Lengths are meters at 20 degrees Celsius.

    diameter : of the spheres; 0 where there is none
    length : distance of the centers of a ball bar, height of a step; 0 where there is none
    u : standard uncertainty of its calibrated lengths and of its form, from its certificate
    """

    kind: str
    diameter: float = 0.0
    length: float = 0.0
    u: float = 0.0

    def __post_init__(self) -> None:
        require_one_of('artifact', self.kind, KINDS)
        require_in_range('artifact: u', self.u, 0.0, 1e-3, 'm')
        for name, value in (('diameter', self.diameter), ('length', self.length)):
            if value:
                require_in_range(f'artifact: {name}', value, _MIN_LENGTH, _MAX_LENGTH, 'm')

    @property
    def spheres(self) -> int:
        """Number of spheres."""
        return {'sphere': 1, 'ball_bar': 2}.get(self.kind, 0)

    def __str__(self) -> str:
        lengths = [value for value in (self.diameter, self.length) if value]
        return ':'.join([self.kind, *(f'{value * 1e3:.7g}mm' for value in lengths)])


def parse_artifact(text: str, u: float = 0.0) -> Artifact:
    """
    Parse an artifact such as 'ball_bar:20.001mm:99.998mm' (diameter, distance of the centers).

    u : meters, standard uncertainty of its lengths
    :raises ParameterError: the text does not describe an artifact
    """
    kind, *parts = text.split(':')
    if kind not in KINDS or len(parts) != _LENGTHS[kind]:
        raise ParameterError(f'artifact: {text!r} is not understood; write {SYNTAX}')
    lengths = [_length(part, text) for part in parts]
    if kind == 'gauge_step':
        return Artifact(kind=kind, length=lengths[0], u=u)
    diameter, length = (*lengths, 0.0, 0.0)[:2]
    return Artifact(kind=kind, diameter=diameter, length=length, u=u)


def _length(part: str, text: str) -> float:
    found = _LENGTH.fullmatch(part.strip())
    if found is None:
        raise ParameterError(f'artifact: {text!r} is not understood; write {SYNTAX}')
    return float(found[1]) * _UNITS[found[2]]
