# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of a scan and their validation."""

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

# Upper limits of a request: one sweep per 10 degrees; 0.02 degrees between profiles; seconds.
MAX_VIEWS = 36
MAX_PROFILES = 20_000
MAX_EXPOSURES = 5
MAX_WARM_UP_S = 1800.0
_EXPOSURE_RANGE = (1e-6, 1.0)  # seconds, that of the node camera

# Part of a folder's name: no path separators, no shell metacharacters, no leading '.' or '-'.
_NAME = re.compile(r'[A-Za-z0-9][A-Za-z0-9._-]{0,62}')


@dataclass(frozen=True, kw_only=True)
class ScanRequest:
    """
    The parameters of a scan at the time when it was accepted.

    part, recipe : names for the catalogue and the folder; the recipe may be empty
    views : number of sweeps that divide one turn, for each laser
    overlap : radians by which a sweep overlaps the next one; a single sweep exceeds the turn by it
    closure : radians by which the last sweep of a scan with one laser exceeds the turn at least,
        with further profiles in the same steps; its end is compared with the beginning, which
        shows lost steps of the table. It is no part of the mesh; 0 for none
    profiles : number of profiles of each view, those of the closure not counted
    motion : 'step' (turn, settle, expose) or 'continuous' (expose during one move per sweep)
    lasers : names of the lasers to use; empty for all of the cell
    dark_frames : in step motion, take an image with all lasers off at every stop, to be subtracted
    exposures : exposure times in seconds, ascending: every sweep is taken with each of them, as a
        view of its own; empty for the camera's own
    warm_up : longest time for which a laser waits, before each sweep, until its stripe rests,
        seconds; 0: it does not wait
    formats : formats of the mesh files
    export_unit : length unit of the mesh files: m, mm or inch
    """

    part: str = 'part'
    recipe: str = ''
    views: int = 1
    overlap: float = 0.0
    closure: float = math.radians(15.0)
    profiles: int = 200
    motion: str = 'continuous'
    lasers: tuple[str, ...] = ()
    dark_frames: bool = False
    exposures: tuple[float, ...] = ()
    warm_up: float = 0.0
    formats: tuple[str, ...] = ('stl', 'ply')
    export_unit: str = 'mm'

    def __post_init__(self) -> None:
        require_name('part', self.part)
        if self.recipe:
            require_name('recipe', self.recipe)
        require_in_range('views', self.views, 1, MAX_VIEWS)
        require_in_range('profiles', self.profiles, 3, MAX_PROFILES)
        require_in_range('overlap', self.overlap, 0.0, math.pi, 'rad')
        require_in_range('closure', self.closure, 0.0, math.pi, 'rad')
        require_one_of('motion', self.motion, MOTIONS)
        require_one_of('export_unit', self.export_unit, UNITS)
        self._require_exposures()
        require_in_range('warm_up', self.warm_up, 0.0, MAX_WARM_UP_S, 's')
        require_formats(self.formats)
        if not self.formats:
            raise ParameterError(f'formats: is empty; known are {", ".join(FORMATS)}')
        if len(set(self.lasers)) != len(self.lasers):
            raise ParameterError(f'lasers: a name occurs twice ({", ".join(self.lasers)})')

    def _require_exposures(self) -> None:
        for seconds in self.exposures:
            require_in_range('exposures', seconds, *_EXPOSURE_RANGE, 's')
        if list(self.exposures) != sorted(set(self.exposures)):
            raise ParameterError('exposures: must ascend, such as 0.002, 0.008')
        if len(self.exposures) > MAX_EXPOSURES:
            raise ParameterError(f'exposures: {len(self.exposures)} are more than {MAX_EXPOSURES}')

    def as_dict(self) -> dict[str, Any]:
        """Return the request as JSON-serializable values."""
        return {
            key: list(value) if isinstance(value, tuple) else value
            for key, value in asdict(self).items()
        }


def require_name(key: str, name: str) -> str:
    """
    Return ``name`` where it is valid as part of a folder's name.

    key : name of the parameter, for the error
    :raises ParameterError: it has other characters than letters, digits, '.', '_' and '-'
    """
    if not _NAME.fullmatch(name) or '..' in name:
        raise ParameterError(
            f'{key}: {name!r} is not a valid name; use 1 to 63 letters, digits, . _ - '
            '(the first a letter or digit)'
        )
    return name
