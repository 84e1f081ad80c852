# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What a scan stores in ``job.json`` to be resumed, and what a resumed scan begins with.

A scan is resumed only with the calibration with which it began, and where the zero of the table is
the same, or is found again by homing: profiles of two zeros would make a wrong shape.
"""

from collections.abc import Mapping
from dataclasses import asdict
from dataclasses import dataclass
from dataclasses import field
from dataclasses import replace
from pathlib import Path
import re
from typing import Any

import numpy as np

from ivfmc_ros.cell.calibration_id import calibration_id
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.cell_file import CellDraft
from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import RecipeError
from ivfmc_ros.errors import ResumeError
from ivfmc_ros.scan import scan_folder
from ivfmc_ros.scan.completeness import Completeness
from ivfmc_ros.scan.plan import MotionLimits
from ivfmc_ros.scan.plan import Plan
from ivfmc_ros.scan.plan import Sweep
from ivfmc_ros.scan.recipe import Recipe
from ivfmc_ros.scan.request import ScanRequest
from ivfmc_ros.scan.state_machine import Stage
from ivfmc_ros.scan.stored_recipe import load_stored_recipe
from ivfmc_ros.scan.stored_recipe import RECIPE_FOLDER
from ivfmc_ros.scan.view_coverage import CompletenessLimits
from ivfmc_ros.storage.messages.profile_header import ProfileHeader
from ivfmc_ros.storage.recording.taken_profiles import read_taken_profiles
from ivfmc_ros.storage.recording.taken_profiles import TakenProfiles

# Ends of a scan whose profiles are right as far as they go.
RESUMABLE = (
    'INTERRUPTED',
    'TURNTABLE_LOST',
    'TRIANGULATOR_LOST',
    'REGISTRAR_LOST',
    'MESHER_LOST',
    'RECORDER_LOST',
    'NOT_RECORDED',
    'DISK_FULL',
    'RESUME_REFUSED',
)
# Keys of job.json: what a scan stores to be resumed, and whether it can be.
COURSE, CAN_RESUME = 'course', 'resumable'

# Name of a folder that ``create_scan_folder`` makes: a stamp, a part and a number.
_SCAN_ID = re.compile(r'[A-Za-z0-9][A-Za-z0-9._-]{0,99}')
# Relative difference of two camera matrices that is rounding.
_ROUNDING = 1e-9
_REMEDY = 'start a new scan, or make the mesh of what was taken with ivfmc reconstruct'


@dataclass(frozen=True, kw_only=True)
class Course:
    """
    What a scan takes, and how far it is.

    tolerance : of table positions, radians
    patience : seconds without progress towards a profile after which the scan fails
    home : the table was homed when the scan began
    begun : the sweeps that have begun, as they were executed
    parts : number of the first profile of each part of the scan, 0 first
    zero : identity of the table's zero (diagnostics of turntable) while they were taken; '' if
        the driver names none
    """

    plan: Plan
    motion: MotionLimits
    limits: CompletenessLimits
    tolerance: float
    patience: float
    home: bool = False
    begun: tuple[Sweep, ...] = ()
    parts: tuple[int, ...] = (0,)
    zero: str = ''

    def as_dict(self) -> dict[str, Any]:
        """Return JSON-serializable values."""
        return {
            'plan': [sweep.as_dict() for sweep in self.plan.sweeps],
            'motion': asdict(self.motion),
            'limits': asdict(self.limits),
            'tolerance': self.tolerance,
            'patience': self.patience,
            'home': self.home,
            'begun': [sweep.as_dict() for sweep in self.begun],
            'parts': list(self.parts),
            'zero': self.zero,
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> 'Course':
        """
        Return what ``as_dict`` described.

        :raises ParameterError: a value is missing, or is not one of a scan
        """
        try:
            found = cls(
                plan=Plan(sweeps=tuple(map(Sweep.from_dict, values['plan']))),
                motion=MotionLimits(**values['motion']),
                limits=CompletenessLimits(**values['limits']),
                tolerance=float(values['tolerance']),
                patience=float(values['patience']),
                home=bool(values['home']),
                begun=tuple(map(Sweep.from_dict, values['begun'])),
                parts=tuple(map(int, values['parts'])),
                zero=str(values['zero']),
            )
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise ParameterError(f'{COURSE}: {type(error).__name__}: {error}') from error
        numbers = [sweep.number for sweep in found.plan.sweeps]
        is_sound = found.parts[:1] == (0,) and sorted(found.parts) == list(found.parts)
        if not numbers or numbers != list(range(len(numbers))) or not is_sound:
            raise ParameterError(f'{COURSE}: plan or parts are not those of a scan')
        return found


@dataclass(frozen=True, eq=False, kw_only=True)
class InterruptedScan:
    """
    A scan that can be resumed.

    course : ``parts`` has the part that begins now
    recipe : the recipe with which it began; None without one
    taken : the profiles of its bag
    camera : with which it began; None if it was interrupted before it had an image
    """

    folder: Path
    request: ScanRequest
    course: Course
    recipe: Recipe | None
    taken: TakenProfiles
    camera: Camera | None
    headers: Mapping[int, ProfileHeader] = field(init=False)

    def __post_init__(self) -> None:
        headers = {place.header.seq: place.header for place in self.taken.locations}
        object.__setattr__(self, 'headers', headers)

    @property
    def first_profile(self) -> int:
        """Number of the first profile that is taken now."""
        return len(self.headers)

    @property
    def planned(self) -> tuple[Sweep, ...]:
        """The sweeps of the plan that have begun, as they were executed."""
        return tuple(sweep for sweep in self.course.begun if sweep.retake_of is None)

    @property
    def is_taken(self) -> bool:
        """Whether no profile is missing: only registration and mesh are left."""
        course = self.course
        completeness = Completeness(course.plan, course.motion, course.limits)
        completeness.take_over(course.begun, course.parts)
        return len(self.planned) == len(course.plan.sweeps) and not any(
            completeness.remaining(sweep, self.headers)
            or completeness.retakes(sweep, self.headers)
            for sweep in self.planned
        )

    def needs_homing(self, zero: str) -> bool:
        """
        Return whether the table has to be homed before the scan goes on.

        zero : identity of the table's zero now, '' if the driver names none
        :raises ResumeError: the zero is another one, and cannot be found again
        """
        if zero and zero == self.course.zero:
            return False
        if self.course.home:
            return True
        if self.is_taken:
            return False
        why = (
            'the zero of the table is not the one with which the scan began (its driver or '
            'controller was restarted, homed, or had an alarm)'
            if zero and self.course.zero
            else 'the driver of the table does not say whether its zero is still the same'
        )
        raise ResumeError(
            f'{self.folder.name}: {why}, and the scan was not homed (parameter home): new '
            f'profiles would not fit those that were taken; {_REMEDY}'
        )

    def require_camera(self, camera: Camera) -> None:
        """:raises ResumeError: the camera has another calibration than when the scan began."""
        if self.camera is not None and not _is_same_camera(self.camera, camera):
            raise ResumeError(
                f'{self.folder / "camera.yaml"}: the camera has another calibration than when the '
                f'scan began; {_REMEDY}'
            )


def load_interrupted(folder: Path, cell: Path) -> InterruptedScan:
    """
    Return a scan that was interrupted; its bag is read as a whole.

    folder : of the scan
    cell : cell.yaml of the cell as it is now
    :raises ResumeError: the scan has ended, runs, is of another calibration, or its recipe is gone
    :raises FileError: a file of the scan cannot be read
    :raises BagError: its bag is gone, or damaged before its end
    """
    if not folder.is_dir():
        raise ResumeError(f'{folder}: there is no such scan')
    job = scan_folder.load_job(folder)
    _require_interrupted(folder, job)
    course, request = _stored(folder, job)
    recipe = _stored_recipe(folder, request)
    _require_same_cell(folder / 'cell.yaml', cell)
    camera_file = folder / 'camera.yaml'
    camera = load_camera(camera_file) if camera_file.exists() else None
    taken = read_taken_profiles(folder)
    count = len(taken.locations)
    if not count:
        raise ResumeError(f'{folder.name}: no profile is in its bag; start a new scan')
    seen = {place.header.view for place in taken.locations}
    return InterruptedScan(
        folder=folder,
        request=request,
        recipe=recipe,
        course=replace(
            course,
            # a sweep without a profile is taken as it was planned
            begun=tuple(sweep for sweep in course.begun if seen & set(sweep.views)),
            parts=(*(part for part in course.parts if part < count), count),
        ),
        taken=taken,
        camera=camera,
    )


def require_scan_id(name: str) -> str:
    """
    Return ``name`` where it can be the id of a scan.

    :raises ParameterError: it has other characters than letters, digits, '.', '_' and '-'
    """
    if not _SCAN_ID.fullmatch(name) or '..' in name:
        raise ParameterError(f'resume_scan: {name!r} is not the id of a scan (no path is taken)')
    return name


def last_interrupted(root: Path) -> str:
    """Return the id of the newest scan below ``root`` that can be resumed, '' if there is none."""
    try:
        names = sorted((path.name for path in root.iterdir() if path.is_dir()), reverse=True)
    except OSError:
        return ''
    for name in names:
        try:
            _require_interrupted(root / name, scan_folder.load_job(root / name))
        except (FileError, ResumeError):
            continue
        return name
    return ''


def _require_interrupted(folder: Path, job: Mapping[str, Any]) -> None:
    stage, code = Stage(job['stage']), job.get('code', '')
    if stage is not Stage.FAILED:
        text = 'it runs' if stage not in (Stage.DONE, Stage.CANCELLED) else f'it is {stage}'
        raise ResumeError(f'{folder.name}: was not interrupted: {text}')
    if COURSE not in job:
        raise ResumeError(f'{folder.name}: was taken by an earlier version; {_REMEDY}')
    if not job.get(CAN_RESUME):
        raise ResumeError(f'{folder.name}: ended with {code}, and cannot go on; {_REMEDY}')
    meshes = sorted(folder.glob('mesh.*'))
    if meshes:
        raise ResumeError(f'{meshes[0]}: exists already and is not overwritten; {_REMEDY}')


def _stored(folder: Path, job: Mapping[str, Any]) -> tuple[Course, ScanRequest]:
    try:
        values: dict[str, Any] = {
            key: tuple(value) if isinstance(value, list) else value
            for key, value in dict(job['request']).items()
        }
        return Course.from_dict(job[COURSE]), ScanRequest(**values)
    except (ParameterError, KeyError, TypeError, ValueError) as error:
        path = folder / scan_folder.JOB_FILE
        raise FileError(f'{path}: is not that of a scan: {error}') from error


def _stored_recipe(folder: Path, request: ScanRequest) -> Recipe | None:
    """:raises ResumeError: the scan began with a recipe whose copy is gone or not valid."""
    try:
        recipe = load_stored_recipe(folder, request.recipe)
    except RecipeError as error:
        raise ResumeError(f'{folder.name}: {error}; {_REMEDY}') from error
    # without a folder of recipes the name is one for the catalogue
    has_recipe = request.recipe and scan_folder.load_parameters(folder).get('recipe_root')
    if has_recipe and recipe is None:
        raise ResumeError(
            f'{folder / RECIPE_FOLDER}: has no recipe {request.recipe}, with which the scan '
            f'began; {_REMEDY}'
        )
    return recipe


def _require_same_cell(began: Path, now: Path) -> None:
    """:raises ResumeError: the calibration is another one."""
    if _identity(load_draft(began)) != _identity(load_draft(now)):
        raise ResumeError(
            f'{began}: the scan began with another calibration than that of {now}; {_REMEDY}'
        )


def _identity(draft: CellDraft) -> tuple[Any, ...]:
    table = draft.turntable
    names = tuple(laser.name for laser in draft.lasers)
    if table is None:
        return (names,)
    return calibration_id(table, draft.lasers), names, table.joint, table.trigger_step


def _is_same_camera(one: Camera, other: Camera) -> bool:
    return (
        (one.width, one.height, one.model) == (other.width, other.height, other.model)
        and one.distortion.shape == other.distortion.shape
        and bool(np.allclose(one.K, other.K, rtol=_ROUNDING, atol=0.0))
        and bool(np.allclose(one.distortion, other.distortion, rtol=_ROUNDING, atol=0.0))
    )
