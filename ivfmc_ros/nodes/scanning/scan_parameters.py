# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the orchestrator: the scan request, the motion limits, and the cell."""

from collections.abc import Mapping
from dataclasses import fields
from dataclasses import replace
import math
from pathlib import Path
from typing import Any

from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.meshing.io.export import FORMATS
from ivfmc_ros.meshing.io.export import UNITS
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.scanning.acceptance_check import declare_check_parameters
from ivfmc_ros.nodes.scanning.acceptance_check import require_check
from ivfmc_ros.nodes.scanning.scan_temperature import declare_temperature_parameters
from ivfmc_ros.scan import request as scan
from ivfmc_ros.scan.plan import MotionLimits
from ivfmc_ros.scan.recipe import load_recipe
from ivfmc_ros.scan.recipe import Recipe
from ivfmc_ros.scan.request import ScanRequest
from ivfmc_ros.scan.resume import require_scan_id
from ivfmc_ros.scan.view_coverage import CompletenessLimits

_HALF_TURN = math.pi
_NAMES = 'letters, digits, . _ -, the first a letter or digit, at most 63'


class ScanParameters:
    """Builds a scan request and motion limits from the current parameter values."""

    def __init__(self, node: CellNode) -> None:
        self._node = node

    def recipe(self) -> Recipe | None:
        """
        Return the recipe of the next scan; None without a name, or without a folder of recipes.

        :raises RecipeError: there is none of this name, or it is not valid
        """
        root, name = self._node.get('recipe_root'), self._node.get('recipe')
        return load_recipe(Path(root), name) if root and name else None

    def request(self, recipe: Recipe | None) -> ScanRequest:
        """
        Return the request of the next scan.

        :raises HelperError: NOT_CHECKED: the last acceptance test of the cell does not allow it
        :raises ParameterError: the values of recipe and parameters together are not valid
        """
        require_check(self._node)
        values = self._values(ScanRequest, recipe)
        if recipe is not None and recipe.part:
            values['part'] = recipe.part
        request = _request(values)
        if recipe is not None and recipe.inspection is not None:
            return _with_uncertainty(request)
        return request

    def motion(self, recipe: Recipe | None) -> MotionLimits:
        """Return the limits of the table motion and the profile rate."""
        return MotionLimits(**self._values(MotionLimits, recipe))

    def limits(self, recipe: Recipe | None) -> CompletenessLimits:
        """Return what a complete view has at least."""
        return CompletenessLimits(**self._values(CompletenessLimits, recipe))

    def _values(self, kind: Any, recipe: Recipe | None) -> dict[str, Any]:
        """Return the values of a class: the parameters, those of the recipe instead."""
        given = {} if recipe is None else recipe.scan
        return {
            field.name: given.get(field.name, self._node.get(field.name)) for field in fields(kind)
        }


def declare_scan_parameters(node: CellNode) -> ScanParameters:
    """Declare all parameters of a scan; values that make no valid request are rejected."""
    _declare_request(node)
    _declare_light(node)
    _declare_recipe(node)
    _declare_motion(node)
    _declare_completeness(node)
    _declare_cell(node)
    _declare_resumption(node)
    declare_check_parameters(node)
    declare_temperature_parameters(node)
    node.check(_require_request)
    node.check(
        lambda values: require_lasers({key: node.get(key) for key in ('cell', 'lasers')}, values)
    )
    return ScanParameters(node)


def _declare_request(node: CellNode) -> None:
    default = ScanRequest()
    node.parameter(
        'part', default.part, 'Name of the part; becomes part of the scan id.', constraints=_NAMES
    )
    node.parameter(
        'views',
        default.views,
        'Number of sweeps into which a turn is divided, for each laser.',
        low=1,
        high=scan.MAX_VIEWS,
    )
    node.parameter(
        'overlap',
        default.overlap,
        'Radians by which a sweep overlaps the next one; a single sweep, its own start.',
        low=0.0,
        high=_HALF_TURN,
    )
    node.parameter(
        'closure',
        default.closure,
        'Radians by which the last sweep of one laser exceeds the turn at least, to show lost '
        'steps of the table; no part of the mesh. 0: none.',
        low=0.0,
        high=_HALF_TURN,
    )
    node.parameter(
        'profiles',
        default.profiles,
        'Number of profiles of each view; a closure adds to them.',
        low=3,
        high=scan.MAX_PROFILES,
    )
    node.parameter(
        'motion',
        default.motion,
        'step: turn, settle, take images; continuous: one motion at constant speed per sweep.',
        choices=scan.MOTIONS,
    )
    node.parameter(
        'formats',
        list(default.formats),
        'Formats of the mesh files.',
        constraints=f'some of {", ".join(FORMATS)}',
    )
    node.parameter(
        'export_unit', default.export_unit, 'Unit of the mesh files.', choices=tuple(UNITS)
    )


def _declare_light(node: CellNode) -> None:
    default = ScanRequest()
    node.parameter('lasers', [], 'Names of the lasers to use; empty: all.', kind=str)
    node.parameter(
        'dark_frames',
        default.dark_frames,
        'step: take an image with all lasers off at every stop and subtract it.',
    )
    node.parameter(
        'exposures',
        [],
        'Exposure times of the camera, seconds, ascending: every sweep is taken with each of '
        'them; empty or 0: that of the camera as it is set.',
        kind=float,
    )
    node.parameter(
        'warm_up',
        default.warm_up,
        'Longest time in seconds for which a laser is on before each sweep until its stripe moves '
        'by less than 0.1 pixels in the sweep; 0: it does not wait.',
        low=0.0,
        high=scan.MAX_WARM_UP_S,
    )


def _declare_recipe(node: CellNode) -> None:
    node.parameter(
        'recipe',
        '',
        'Name of the recipe: a file in recipe_root, whose values replace those of the parameters; '
        'without recipe_root a name for the catalogue.',
        constraints=_NAMES,
    )
    node.parameter(
        'recipe_root',
        '',
        'Folder of the recipes, <name>.yaml; empty: there are none.',
        read_only=True,
    )


def _declare_motion(node: CellNode) -> None:
    default = MotionLimits()
    node.parameter(
        'profile_rate',
        default.profile_rate,
        'Profiles per second of the camera; determines the speed of continuous motion.',
        low=0.1,
        high=1000.0,
    )
    node.parameter(
        'velocity', default.velocity, 'Maximum velocity of the table, rad/s.', low=0.01, high=50.0
    )
    node.parameter(
        'acceleration',
        default.acceleration,
        'Acceleration of the table, rad/s^2.',
        low=0.01,
        high=500.0,
    )
    node.parameter(
        'lead_time',
        default.lead_time,
        'Seconds at constant speed before the first profile of a sweep and after the last; '
        '0: 0.1 and the time of three profiles.',
        low=0.0,
        high=10.0,
    )


def _declare_completeness(node: CellNode) -> None:
    default = CompletenessLimits()
    node.parameter(
        'max_gap',
        default.max_gap,
        'Greatest difference in angle of neighboring profiles, in planned steps; missing angles '
        'are taken again (continuous), else the scan ends as INCOMPLETE.',
        low=1.5,
        high=1e6,
    )
    node.parameter(
        'min_profiles',
        default.min_profiles,
        'Least share of the planned profiles of a view; with fewer the scan ends as INCOMPLETE.',
        low=0.0,
        high=1.0,
    )
    node.parameter(
        'min_stripe',
        default.min_stripe,
        'Least share of the profiles of a view that show the stripe; with fewer the scan ends as '
        'INCOMPLETE.',
        low=0.0,
        high=1.0,
    )
    node.parameter(
        'max_spacing',
        default.max_spacing,
        'Meters, greatest distance of neighboring profiles on the part, at its outer points; '
        'where it is greater, the angles are taken again in finer steps, else the scan ends as '
        'INCOMPLETE. 0: as planned.',
        low=0.0,
        high=1.0,
    )


def _declare_cell(node: CellNode) -> None:
    node.parameter('cell', '', 'Path of cell.yaml; read when a scan is accepted.')
    node.parameter(
        'scan_root', 'scans', 'Folder of the scans and of their catalogue.', read_only=True
    )
    node.parameter(
        'min_free_space',
        200.0,
        'Megabytes of the disk of scan_root that stay free: a scan that does not fit is refused, '
        'one that fills the disk ends, as DISK_FULL.',
        low=1.0,
        high=1e9,
    )
    node.parameter('home', False, 'Home the table before a scan; requires a home switch.')
    node.parameter(
        'position_tolerance',
        2e-3,
        'Tolerance of table positions, radians.',
        low=1e-6,
        high=0.1,
    )
    node.parameter(
        'profile_patience',
        20.0,
        'Seconds without progress towards an expected profile after which the scan fails.',
        low=1.0,
        high=600.0,
    )
    node.parameter(
        'heartbeat_limit',
        2.0,
        'Seconds without a heartbeat or joint state after which a node is lost.',
        low=0.3,
        high=60.0,
        read_only=True,
    )


def _declare_resumption(node: CellNode) -> None:
    node.parameter(
        'resume_scan',
        '',
        'Id of an interrupted scan, with which the service resume goes on while no scan runs.',
        constraints='a folder of scan_root',
    )
    node.check(_require_resume_scan)


def _require_resume_scan(values: Mapping[str, Any]) -> None:
    if values.get('resume_scan'):
        require_scan_id(values['resume_scan'])


def _request(values: Mapping[str, Any]) -> ScanRequest:
    known: dict[str, Any] = {field.name: values[field.name] for field in fields(ScanRequest)}
    for name in ('lasers', 'formats'):
        # rclpy cannot set an empty list, but a list with one empty string
        known[name] = tuple(item for item in known[name] if item)
    # likewise a zero
    known['exposures'] = tuple(seconds for seconds in known['exposures'] if seconds)
    return ScanRequest(**known)


def _with_uncertainty(request: ScanRequest) -> ScanRequest:
    """Return a request whose mesh files state the uncertainty of the vertices, to be judged."""
    if 'ply' in request.formats:
        return request
    return replace(request, formats=(*request.formats, 'ply'))


def require_lasers(before: Mapping[str, Any], values: Mapping[str, Any]) -> None:
    """
    Refuse lasers that the cell does not have, to the caller that sets them.

    A cell.yaml that cannot be read is refused when a scan starts.

    before, values : the parameters ``cell`` and ``lasers`` as they are, and as they would be
    :raises ParameterError: a laser is not in cell.yaml
    """
    if 'lasers' not in values or 'cell' not in values:
        # declared later, at the start of the node
        return
    changed = any(list(values[key]) != list(before[key]) for key in ('lasers', 'cell'))
    names = [name for name in values['lasers'] if name]
    if not changed or not names or not values['cell']:
        return
    try:
        draft = load_draft(Path(values['cell']))
    except ScanError:
        return
    known = [laser.name for laser in draft.lasers]
    unknown = [name for name in names if name not in known]
    if unknown:
        raise ParameterError(
            f'lasers: {unknown[0]!r} is not a laser of {values["cell"]}, which has '
            f'{", ".join(known)}; set lasers and cell together'
        )


def _require_request(values: Mapping[str, Any]) -> None:
    # during the start of the node some are not declared yet
    if all(field.name in values for field in fields(ScanRequest)):
        _request(values)
