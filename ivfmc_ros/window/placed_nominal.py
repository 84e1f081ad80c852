# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Deviations of points from the nominal of a recipe, placed by the inspection or by a fit."""

from dataclasses import dataclass
from dataclasses import replace
import json
from pathlib import Path

import numpy as np

from ivfmc_ros import files
from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import RecipeError
from ivfmc_ros.inspection.conditions import Conditions
from ivfmc_ros.inspection.mesh_file import read_mesh
from ivfmc_ros.inspection.nominal_faults import align_to_nominal
from ivfmc_ros.inspection.nominal_faults import oriented
from ivfmc_ros.inspection.reports.color_scale import ColorBar
from ivfmc_ros.model import Floats
from ivfmc_ros.scan.recipe import InspectionPlan
from ivfmc_ros.scan.recipe_verdict import INSPECTION
from ivfmc_ros.scan.scan_folder import load_job
from ivfmc_ros.scan.stored_recipe import load_stored_recipe
from ivfmc_ros.surface import Surface


def deviation_bar(tolerance: float) -> ColorBar:
    """Return the scale of the report of an inspection: it ends at twice the tolerance, meters."""
    return ColorBar(
        low=-2.0 * tolerance, high=2.0 * tolerance, quantity='deviation', tolerance=tolerance
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class PlacedNominal:
    """
    A closed surface, and where it lies in a scan.

    nominal_from_mesh : (4, 4)
    scale : factor of lengths of the scan, to 20 degrees Celsius
    tolerance : meters, to either side
    is_provisional : placed by a fit to the points, before the inspection
    """

    surface: Surface
    nominal_from_mesh: Floats
    scale: float
    tolerance: float
    is_provisional: bool = False

    @property
    def bar(self) -> ColorBar:
        """The colors of deviations."""
        bar = deviation_bar(self.tolerance)
        return replace(bar, quantity='provisional deviation') if self.is_provisional else bar

    def deviations(self, points_xyz: Floats) -> Floats:
        """Return (n,) meters from the nominal, positive outside, of (n, 3) points of the scan."""
        return self.surface.signed_distance(
            transforms.apply(self.nominal_from_mesh, points_xyz * self.scale)
        )


def load_placed_nominal(folder: Path) -> PlacedNominal | None:
    """
    Read the nominal of an inspected scan, and where the inspection placed it.

    folder : of the scan
    :returns: None for a scan without an inspection, or without a copy of its recipe
    :raises FileError: ``inspection.json`` or the nominal cannot be read
    :raises RecipeError: the copy is not valid, or has another nominal than the inspection
    """
    path = folder / INSPECTION
    if not path.is_file():
        return None
    try:
        document = json.loads(files.read_bytes(path))
        name, nominal = str(document['recipe']), str(document['nominal'])
        placed = np.array(document['alignment']['nominal_from_mesh'], dtype=np.float64)
        scale = Conditions(**document['conditions']).to_reference
        tolerance = float(document['tolerance_m'])
    except (ValueError, KeyError, TypeError) as error:
        raise FileError(f'{path}: is no result of an inspection ({error})') from error
    recipe = load_stored_recipe(folder, name)
    if recipe is None:
        return None
    plan = recipe.inspection
    if plan is None or plan.nominal.name != nominal:
        raise RecipeError(
            f'recipe {name} of {folder.name}: has not the nominal of the inspection, {nominal}'
        )
    body, _ = oriented(read_mesh(plan.nominal, plan.unit))
    return PlacedNominal(
        surface=Surface(body.vertices_xyz, body.faces),
        nominal_from_mesh=placed,
        scale=scale,
        tolerance=tolerance,
    )


def plan_of_scan(folder: Path) -> InspectionPlan | None:
    """
    Return how a running scan will be judged.

    :returns: None where it will not be, or by datum features, which only a mesh has
    :raises ScanError: ``job.json`` or the recipe cannot be read
    """
    name = str(load_job(folder).get('request', {}).get('recipe', ''))
    recipe = load_stored_recipe(folder, name)
    plan = None if recipe is None else recipe.inspection
    return None if plan is None or plan.datums else plan


def fit_nominal(points_xyz: Floats, plan: InspectionPlan) -> PlacedNominal | None:
    """
    Place the nominal of a plan by (n, 3) registered points, before there is a mesh.

    :returns: None where the points do not lie on the nominal
    :raises ScanError: the nominal cannot be read, or the points determine no pose
    """
    settings = plan.settings
    body, _ = oriented(read_mesh(plan.nominal, plan.unit))
    surface, scale = Surface(body.vertices_xyz, body.faces), settings.conditions.to_reference
    alignment, notes = align_to_nominal(points_xyz * scale, surface, body, settings)
    if notes and alignment.method == settings.align:
        return None
    return PlacedNominal(
        surface=surface,
        nominal_from_mesh=alignment.nominal_from_mesh,
        scale=scale,
        tolerance=settings.tolerance,
        is_provisional=True,
    )
