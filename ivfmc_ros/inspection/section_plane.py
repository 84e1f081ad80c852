# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Plane of a section cut, as a user writes it: ``z=12.5``, ``x=-3mm``, or ``y`` for the middle."""

from collections.abc import Sequence
from dataclasses import dataclass
import re

from ivfmc_ros.errors import ParameterError

AXES = 'xyz'
_MM = 1e-3
_PLANE = re.compile(r'\s*([xyz])\s*(?:=\s*([+-]?(?:\d+\.?\d*|\.\d+))\s*(?:mm)?\s*)?')
# Meters; a coordinate beyond is a mistake.
_MAX_OFFSET = 10.0


@dataclass(frozen=True)
class SectionPlane:
    """
    A plane normal to an axis of the nominal's frame.

    axis : x, y or z
    offset : its coordinate on this axis, meters; None for the middle of the nominal
    :raises ParameterError: another axis, or an offset that is not finite or out of range
    """

    axis: str
    offset: float | None = None

    def __post_init__(self) -> None:
        if self.axis not in tuple(AXES):
            raise ParameterError(f'section: {self.axis!r} is not one of x, y, z')
        if self.offset is not None and not abs(self.offset) <= _MAX_OFFSET:
            raise ParameterError(f'section: {self.offset} is out of range; it must be up to 10 m')


# Text for no section at all.
_NONE = 'none'
# One cut normal to each axis, through the middle of the nominal.
MIDDLE_PLANES = tuple(SectionPlane(axis) for axis in AXES)


def parse_section(text: str) -> SectionPlane:
    """
    Return the plane of a text such as 'z=12.5' (millimeters) or 'x' (the middle).

    :raises ParameterError: the text is no plane
    """
    found = _PLANE.fullmatch(text)
    if found is None:
        raise ParameterError(
            f'section: {text!r} is not understood; write an axis and a coordinate in mm of the '
            "nominal's frame, such as z=12.5, or an axis alone for the middle"
        )
    return SectionPlane(found[1], None if found[2] is None else _MM * float(found[2]))


def parse_sections(texts: Sequence[str]) -> tuple[SectionPlane, ...]:
    """
    Return the planes of texts; 'none' alone, and an empty sequence, stand for none.

    :raises ParameterError: a text is no plane, or the same plane comes twice
    """
    if tuple(texts) == (_NONE,):
        return ()
    planes = tuple(parse_section(text) for text in texts)
    twice = [text for k, text in enumerate(texts) if planes[k] in planes[:k]]
    if twice:
        raise ParameterError(f'section: {twice[0]!r} is given twice')
    return planes
