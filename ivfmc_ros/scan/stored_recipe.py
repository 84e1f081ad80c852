# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The copy of a recipe in the folder of a scan.

A scan is judged, resumed and shown by the recipe and the nominal with which it began, whatever
becomes of the folder of the recipes meanwhile.
"""

from pathlib import Path
import shutil

from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import RecipeError
from ivfmc_ros.scan.recipe import load_recipe
from ivfmc_ros.scan.recipe import Recipe
from ivfmc_ros.scan.recipe import recipe_file

RECIPE_FOLDER = 'recipe'


def store_recipe(recipe: Recipe, root: Path, folder: Path) -> Recipe:
    """
    Copy a recipe and its nominal to the folder of a scan; return the recipe as it is there.

    recipe : of the folder ``root`` of recipes
    :raises FileError: a file cannot be copied
    :raises RecipeError: the recipe was changed since it was read
    """
    target = folder / RECIPE_FOLDER
    sources = [recipe_file(root, recipe.name)]
    if recipe.inspection is not None:
        sources.append(recipe.inspection.nominal)
    for source in sources:
        # the nominal may lie in a folder of its own
        copy = target / source.resolve().relative_to(root.resolve())
        try:
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, copy)
        except OSError as error:
            raise FileError(
                f'{source}: cannot be copied to {copy}: {error.strerror or error}'
            ) from error
    stored = load_recipe(target, recipe.name)
    if (stored.part, stored.scan) != (recipe.part, recipe.scan):
        raise RecipeError(f'{sources[0]}: was changed while the scan was accepted; start it again')
    return stored


def load_stored_recipe(folder: Path, name: str) -> Recipe | None:
    """
    Read the recipe with which a scan began.

    folder : of the scan
    name : of the recipe; '' for none
    returns : None where the scan has no copy of a recipe
    :raises RecipeError: the copy is not valid
    """
    root = folder / RECIPE_FOLDER
    return load_recipe(root, name) if name and root.is_dir() else None
