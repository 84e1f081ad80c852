# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a scan is asked to be."""

from dataclasses import asdict
from dataclasses import dataclass
import math
import re
from typing import Any

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.meshing.io.export import FORMATS
from ivfmc_ros.meshing.io.export import require_formats
from ivfmc_ros.meshing.io.export import UNITS
from ivfmc_ros.validation import require_in_range
from ivfmc_ros.validation import require_one_of

MOTIONS = ('continuous', 'step')

MAX_VIEWS = 36
MAX_PROFILES = 20_000

# What becomes part of the name of a folder must not leave it, nor mean something to a shell.
_NAME = re.compile(r'[A-Za-z0-9][A-Za-z0-9._-]{0,62}')


@dataclass(frozen=True, kw_only=True)
class ScanRequest:
    """
    The parameters of a scan, as they were when it was accepted.

    part, recipe : names, for the catalogue and the folder; the recipe may be empty
    views : sweeps that share a turn, for each laser
    overlap : radians by which a sweep reaches into the next; of a single one, beyond the turn
    profiles : of each view
    motion : 'step' (turn, settle, take pictures) or 'continuous' (one smooth turn a sweep)
    lasers : names; empty for all of the cell
    dark_frames : take a picture with all lasers off at every stop, to be subtracted; only in
        step motion, for a table that turns has no stop
    formats : of the mesh files
    export_unit : of the mesh files: m, mm or inch
    """

    part: str = 'part'
    recipe: str = ''
    views: int = 1
    overlap: float = 0.0
    profiles: int = 200
    motion: str = 'continuous'
    lasers: tuple[str, ...] = ()
    dark_frames: bool = False
    formats: tuple[str, ...] = ('stl', 'ply')
    export_unit: str = 'mm'

    def __post_init__(self) -> None:
        require_name('part', self.part)
        if self.recipe:
            require_name('recipe', self.recipe)
        require_in_range('views', self.views, 1, MAX_VIEWS)
        require_in_range('profiles', self.profiles, 3, MAX_PROFILES)
        require_in_range('overlap', self.overlap, 0.0, math.pi, 'rad')
        require_one_of('motion', self.motion, MOTIONS)
        require_one_of('export_unit', self.export_unit, UNITS)
        require_formats(self.formats)
        if not self.formats:
            raise ParameterError(f'formats: is empty; known are {", ".join(FORMATS)}')
        if len(set(self.lasers)) != len(self.lasers):
            raise ParameterError(f'lasers: one is named twice ({", ".join(self.lasers)})')

    def as_dict(self) -> dict[str, Any]:
        """Return the request as plain values, for files and answers."""
        return {
            key: list(value) if isinstance(value, tuple) else value
            for key, value in asdict(self).items()
        }


def require_name(key: str, name: str) -> str:
    """
    Return a name that may become a folder's.

    :raises ParameterError: it has other characters than letters, digits, '.', '_' and '-'
    """
    if not _NAME.fullmatch(name) or '..' in name:
        raise ParameterError(
            f'{key}: {name!r} is not usable as a name; use 1 to 63 letters, digits, . _ - '
            '(the first a letter or digit)'
        )
    return name
