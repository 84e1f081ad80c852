# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc recipes``: lists, shows and checks the recipes of a cell."""

from pathlib import Path
import sys
from typing import Any

import click
from rich.markup import escape
from rich.table import Table

from ivfmc_ros.cli.support.output import console
from ivfmc_ros.cli.support.output import json_option
from ivfmc_ros.cli.support.output import print_json
from ivfmc_ros.errors import RecipeError
from ivfmc_ros.scan.recipe import load_recipe
from ivfmc_ros.scan.recipe import Recipe
from ivfmc_ros.scan.recipe import recipe_names
from ivfmc_ros.scan.recipe import setting_text

_DEFAULT = Path('ivfmc_run/recipes')
_COLUMNS = ('recipe', 'part', 'scan', 'nominal', 'tolerance, mm', 'description')


@click.command()
@click.argument('names', nargs=-1)
@click.option(
    '--folder',
    type=click.Path(path_type=Path),
    default=_DEFAULT,
    show_default=True,
    help='Folder of the recipes.',
)
@json_option
def recipes(names: tuple[str, ...], folder: Path, as_json: bool) -> None:
    """
    Show the recipes NAMES, or all of a folder, and check them.

    The exit code is 1 if one of them is not valid.
    """
    found: list[Recipe] = []
    errors: list[str] = []
    for name in names or recipe_names(folder):
        try:
            found.append(load_recipe(folder, name))
        except RecipeError as error:
            errors.append(str(error))
    if as_json:
        print_json({'recipes': [_document(recipe) for recipe in found], 'errors': errors})
    else:
        _print(found, errors)
    if errors:
        sys.exit(1)


def _document(recipe: Recipe) -> dict[str, Any]:
    plan = recipe.inspection
    inspection = None
    if plan is not None:
        inspection = {
            'nominal': str(plan.nominal),
            'unit': plan.unit,
            'align': plan.settings.align,
            'datums': list(plan.datums),
            'tolerance_m': plan.settings.tolerance,
            'features_m': {name: dict(given) for name, given in plan.settings.features.items()},
            'conditions': vars(plan.settings.conditions),
        }
    return {
        'name': recipe.name,
        'part': recipe.part,
        'description': recipe.description,
        'scan': dict(recipe.scan),
        'inspection': inspection,
    }


def _print(found: list[Recipe], errors: list[str]) -> None:
    stdout = console(markup=True)
    table = Table()
    for column in _COLUMNS:
        table.add_column(column)
    for recipe in found:
        plan = recipe.inspection
        values = ', '.join(f'{key} {setting_text(value)}' for key, value in recipe.scan.items())
        nominal = plan.nominal.name if plan else ''
        tolerance = f'{plan.settings.tolerance * 1e3:g}' if plan else ''
        row = (recipe.name, recipe.part, values, nominal, tolerance, recipe.description)
        table.add_row(*map(escape, row))
    if found:
        stdout.print(table)
    stderr = console(stderr=True)
    for error in errors:
        stderr.print(f'ivfmc: error: {error}', soft_wrap=True)
    if not found and not errors:
        stdout.print('no recipes')
