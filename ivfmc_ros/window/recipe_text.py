# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a recipe sets, as HTML for the operator who chooses it."""

from html import escape
from pathlib import Path

from ivfmc_ros.errors import RecipeError
from ivfmc_ros.scan.recipe import load_recipe
from ivfmc_ros.scan.recipe import Recipe
from ivfmc_ros.scan.recipe import setting_text


def recipe_html(root: Path, name: str) -> str:
    """
    Return a table of what a recipe sets; or, as an alert, why it cannot be used.

    The file is read at each call: it may have been edited since.
    """
    try:
        recipe = load_recipe(root, name)
    except RecipeError as error:
        return f'<p role="alert" style="color:#8f1010">{escape(str(error))}</p>'
    cells = ''.join(
        f'<tr><th scope="row" style="text-align:left">{escape(key)}</th>'
        f'<td>{escape(value)}</td></tr>'
        for key, value in _rows(recipe)
    )
    description = f'<p>{escape(recipe.description)}</p>' if recipe.description else ''
    return f'{description}<table aria-label="Recipe {escape(name)}">{cells}</table>'


def _rows(recipe: Recipe) -> list[tuple[str, str]]:
    rows = [('part', recipe.part)] if recipe.part else []
    rows += [(key.replace('_', ' '), setting_text(value)) for key, value in recipe.scan.items()]
    plan = recipe.inspection
    if plan is None:
        return [*rows, ('judged', 'no')]
    settings = plan.settings
    rows += [
        ('judged by', plan.nominal.name),
        ('tolerance', f'±{settings.tolerance * 1e3:g} mm'),
        ('alignment', ' '.join([settings.align.replace('_', ' '), *plan.datums])),
    ]
    rows += [
        (feature, ', '.join(f'{key} {value * 1e3:g} mm' for key, value in given.items()))
        for feature, given in settings.features.items()
    ]
    return rows
