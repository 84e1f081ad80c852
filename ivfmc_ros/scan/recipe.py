# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Recipes: how a part is scanned, and the CAD model and tolerances by which its mesh is judged.

A recipe is a YAML file ``<name>.yaml`` in the folder of the recipes, with its nominal beside it.
Its form is ``config/schemas/recipe-1.json``. Values have the names and units of the parameters of
the orchestrator; lengths of ``inspection`` are millimeters.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field
from dataclasses import fields
from pathlib import Path
from typing import Any

from ivfmc_ros.cell.fields import YamlMapping
from ivfmc_ros.errors import CellError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import RecipeError
from ivfmc_ros.inspection.conditions import Conditions
from ivfmc_ros.inspection.section_plane import MIDDLE_PLANES
from ivfmc_ros.inspection.section_plane import parse_sections
from ivfmc_ros.inspection.section_plane import SectionPlane
from ivfmc_ros.inspection.settings import ALIGNMENTS
from ivfmc_ros.inspection.settings import InspectSettings
from ivfmc_ros.inspection.tolerances import feature_tolerances
from ivfmc_ros.meshing.io.export import UNITS
from ivfmc_ros.scan.plan import MotionLimits
from ivfmc_ros.scan.request import require_name
from ivfmc_ros.scan.request import ScanRequest
from ivfmc_ros.scan.view_coverage import CompletenessLimits
from ivfmc_ros.validation import require_one_of

_SUFFIX = '.yaml'
_MM = 1e-3
_CONDITIONS = tuple(item.name for item in fields(Conditions))
# Parameters of the orchestrator that a recipe may set, with the class that checks each.
_SCAN_CLASSES = (ScanRequest, MotionLimits, CompletenessLimits)
SCAN_KEYS = tuple(
    item.name
    for kind in _SCAN_CLASSES
    for item in fields(kind)
    if item.name not in ('part', 'recipe')
)


@dataclass(frozen=True, kw_only=True)
class InspectionPlan:
    """
    How the mesh of a scan is judged.

    nominal : file of the CAD model, and its length unit
    datums : names of features for the alignment ``datum``
    states_temperature : the recipe gives the temperature of the part; otherwise a sensor may
    """

    nominal: Path
    unit: str
    settings: InspectSettings
    datums: tuple[str, ...] = ()
    states_temperature: bool = False


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """
    How a part is scanned.

    part : its name in the catalogue; '' for the one that the caller sets
    scan : values that replace the parameters of the orchestrator for one scan
    inspection : None where the mesh is not judged
    """

    name: str
    part: str = ''
    description: str = ''
    scan: Mapping[str, Any] = field(default_factory=dict)
    inspection: InspectionPlan | None = None


def recipe_names(root: Path) -> list[str]:
    """
    Return the names of the recipes in a folder.

    :raises RecipeError: it is no folder
    """
    if not root.is_dir():
        raise RecipeError(f'{root}: is no folder of recipes')
    return sorted(path.stem for path in root.glob(f'*{_SUFFIX}'))


def recipe_file(root: Path, name: str) -> Path:
    """Return the file of a recipe in the folder of the recipes."""
    return root / f'{name}{_SUFFIX}'


def setting_text(value: Any) -> str:
    """Return a value that a recipe sets, for a person."""
    return ' '.join(map(str, value)) if isinstance(value, tuple) else str(value)


def load_recipe(root: Path, name: str) -> Recipe:
    """
    Read a recipe.

    :raises RecipeError: there is none of this name, or it is not valid; names file and key
    """
    try:
        require_name('recipe', name)
    except ParameterError as error:
        raise RecipeError(str(error)) from None
    path = recipe_file(root, name)
    if not path.is_file():
        known = ', '.join(recipe_names(root)) or 'none'
        raise RecipeError(f'recipe: there is no {path}; there are: {known}')
    try:
        return _recipe(path, name)
    except RecipeError:
        raise
    except (CellError, ParameterError) as error:
        # errors of the reader of YAML name the file, those of values do not
        text = str(error)
        raise RecipeError(text if text.startswith(str(path)) else f'{path}: {text}') from None


def _recipe(path: Path, name: str) -> Recipe:
    top = YamlMapping.read(path)
    top.require_known_keys('version', 'part', 'description', 'scan', 'inspection')
    version = top.values.get('version', 1)
    if version != 1:
        raise top.error('version', f'{version!r} is not known; this program reads version 1')
    part = require_name('part', top.text('part')) if top.has('part') else ''
    return Recipe(
        name=name,
        part=part,
        description=top.text('description') if top.has('description') else '',
        scan=_scan(top.mapping('scan')) if top.has('scan') else {},
        inspection=_inspection(path, top.mapping('inspection')) if top.has('inspection') else None,
    )


def _scan(given: YamlMapping) -> dict[str, Any]:
    """Return the checked values; what depends on the cell is checked when a scan is accepted."""
    given.require_known_keys(*SCAN_KEYS)
    values = dict(given.values)
    for kind in _SCAN_CLASSES:
        own = {item.name: item.default for item in fields(kind) if item.name in values}
        for key, default in own.items():
            values[key] = _typed(given, key, default)
        try:
            kind(**{key: values[key] for key in own})
        except ParameterError as error:
            raise RecipeError(f'{given.where}: {error}') from None
    return values


def _typed(given: YamlMapping, key: str, default: Any) -> Any:
    """Return a value of the type of its default; YAML has no tuples and reads 4e-5 as text."""
    value = given.required(key)
    if key == 'exposures':
        if not isinstance(value, list) or not all(type(item) in (int, float) for item in value):
            raise given.error(key, 'must be a list of seconds')
        return tuple(map(float, value))
    if isinstance(default, tuple):
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            raise given.error(key, 'must be a list of names')
        return tuple(value)
    if isinstance(default, float):
        return given.number(key)
    # True is an int to Python
    if type(value) is not type(default):
        what = {int: 'a whole number', bool: 'true or false', str: 'a text'}[type(default)]
        raise given.error(key, f'{value!r} must be {what}')
    return value


def _inspection(path: Path, given: YamlMapping) -> InspectionPlan:
    given.require_known_keys(
        'nominal', 'unit', 'tolerance', 'features', 'align', 'datums', 'sections', *_CONDITIONS
    )
    unit = str(given.values.get('unit', 'mm'))
    align = str(given.values.get('align', 'best_fit'))
    try:
        require_one_of('unit', unit, UNITS)
        require_one_of('align', align, ALIGNMENTS)
    except ParameterError as error:
        raise RecipeError(f'{given.where}: {error}') from None
    datums = given.values.get('datums', [])
    if not isinstance(datums, list) or not all(isinstance(item, str) for item in datums):
        raise given.error('datums', 'must be a list of feature names')
    if (align == 'datum') != bool(datums):
        raise given.error('datums', 'belong to align: datum, which needs them')
    try:
        settings = InspectSettings(
            tolerance=_MM * given.number('tolerance'),
            features=feature_tolerances(given.values.get('features')),
            align=align,
            sections=_sections(given),
            conditions=Conditions(
                **{key: given.number(key) for key in _CONDITIONS if given.has(key)}
            ),
        )
    except ParameterError as error:
        raise RecipeError(f'{given.where}: {error}') from None
    nominal = _nominal(path, given)
    return InspectionPlan(
        nominal=nominal,
        unit=unit,
        settings=settings,
        datums=tuple(datums),
        states_temperature=given.has('temperature'),
    )


def _sections(given: YamlMapping) -> tuple[SectionPlane, ...]:
    """Return the planes of section cuts; an empty list stands for none."""
    if not given.has('sections'):
        return MIDDLE_PLANES
    texts = given.values['sections']
    if not isinstance(texts, list) or not all(isinstance(text, str) for text in texts):
        raise given.error('sections', 'must be a list of planes such as z=12.5')
    return parse_sections(texts)


def _nominal(path: Path, given: YamlMapping) -> Path:
    """Return the file of the nominal, which lies in the folder of the recipes."""
    root = path.parent.resolve()
    found = (root / given.text('nominal')).resolve()
    if root not in found.parents:
        raise given.error('nominal', f'{given.text("nominal")!r} is not below {root}')
    if not found.is_file():
        raise given.error('nominal', f'{found}: file not found')
    return found
