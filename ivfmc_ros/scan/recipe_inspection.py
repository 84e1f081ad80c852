# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Judges the mesh of a scan by its recipe: ``inspection.json`` and ``inspection.html``.

``recipe_verdict`` runs it as a process.
"""

from dataclasses import replace
import os
from pathlib import Path
import sys
from typing import Any

from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import RecipeError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.inspection.datum_alignment import align_features
from ivfmc_ros.inspection.inspect import inspect
from ivfmc_ros.inspection.mesh_file import read_mesh
from ivfmc_ros.inspection.mesh_file import require_closed
from ivfmc_ros.inspection.mesh_file import require_similar_size
from ivfmc_ros.inspection.reports.html import write_html
from ivfmc_ros.inspection.reports.inspection_page import inspection_page
from ivfmc_ros.inspection.reports.json_report import write_report
from ivfmc_ros.inspection.reports.summary import document
from ivfmc_ros.inspection.settings import InspectSettings
from ivfmc_ros.scan import scan_folder
from ivfmc_ros.scan.recipe import InspectionPlan
from ivfmc_ros.scan.recipe import load_recipe
from ivfmc_ros.scan.recipe import Recipe
from ivfmc_ros.scan.recipe_verdict import INSPECTION
from ivfmc_ros.scan.recipe_verdict import INSPECTION_PAGE
from ivfmc_ros.scan.stored_recipe import RECIPE_FOLDER
from ivfmc_ros.scan.temperature import load_temperature
from ivfmc_ros.scan.temperature import TEMPERATURE_FILE
from ivfmc_ros.scan.title_block import title_block
from ivfmc_ros.worker import end_with_parent

# Mesh files that carry the uncertainty of their vertices: PLY, or STL with an .npz beside it.
_MESHES = ('mesh.ply', 'mesh.stl')
# Nice value of the process: the nodes of the cell come first.
_NICE = 5


def inspect_scan(folder: Path, recipe: Recipe) -> dict[str, Any]:
    """
    Compare the mesh of a scan with the nominal of its recipe, and write the result beside it.

    returns : the figures that are in ``inspection.json``
    :raises ScanError: there is no mesh, the nominal cannot be used, or a file cannot be written
    """
    plan = recipe.inspection
    if plan is None:
        raise RecipeError(f'recipe {recipe.name}: has no inspection')
    cell = load_draft(folder / 'cell.yaml').complete(
        load_camera(folder / 'camera.yaml'), str(folder / 'cell.yaml')
    )
    settings = _at_temperature(plan, folder).with_scale_of(cell)
    path, unit = _mesh_of(folder)
    mesh, nominal = read_mesh(path, unit), read_mesh(plan.nominal, plan.unit)
    require_similar_size(mesh, nominal, (path, plan.nominal), (unit, plan.unit))
    require_closed(nominal, plan.nominal)
    alignment = align_features(mesh, nominal, plan.datums, settings) if plan.datums else None
    found = inspect(mesh, nominal, settings, cell, alignment)
    figures = {
        'recipe': recipe.name,
        'mesh': path.name,
        'nominal': plan.nominal.name,
        **document(found, settings),
    }
    title = f'{folder.name} against {plan.nominal.name}'
    page = inspection_page(title, found, settings, figures, title_block(folder))
    write_html(folder / INSPECTION_PAGE, page)
    # last: who finds it finds the page too
    write_report(folder / INSPECTION, figures)
    return figures


def _at_temperature(plan: InspectionPlan, folder: Path) -> InspectSettings:
    """Return the settings at the temperature of the scan's sensor, if the recipe states none."""
    measured = load_temperature(folder)
    if measured is None or plan.states_temperature:
        return plan.settings
    where = folder / TEMPERATURE_FILE
    conditions = measured.applied_to(plan.settings.conditions, where)
    return replace(plan.settings, conditions=conditions)


def _mesh_of(folder: Path) -> tuple[Path, str]:
    unit = str(scan_folder.load_job(folder)['request'].get('export_unit', 'mm'))
    for name in _MESHES:
        if (folder / name).is_file():
            return folder / name, unit
    raise FileError(f'{folder}: has none of {", ".join(_MESHES)}; name ply in formats')


def main() -> None:
    """Inspect the scan folder that the command line names by its stored recipe: folder, name."""
    end_with_parent()
    os.nice(_NICE)
    folder, name = Path(sys.argv[1]), sys.argv[2]
    try:
        inspect_scan(folder, load_recipe(folder / RECIPE_FOLDER, name))
    except ScanError as error:
        sys.exit(str(error))


if __name__ == '__main__':
    main()
