# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Inspections of rendered scans, in the terms of the bench."""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass

from bench.inspection_parts import PARTS
from bench.inspection_parts import perpendicular_planes
from bench.inspection_parts import with_feature_off
from bench.inspection_scans import mesh_of
from bench.inspection_scans import placement
from ivfmc_ros.inspection.datum_alignment import align_features
from ivfmc_ros.inspection.inspect import inspect
from ivfmc_ros.inspection.inspect import Inspection
from ivfmc_ros.inspection.mesh_file import MeshBody
from ivfmc_ros.inspection.settings import InspectSettings
from ivfmc_ros.simulation.parts.loading import Solid

# Seeds of right and of wrong parts.
FIRST_RIGHT, FIRST_WRONG = 101, 201
TOLERANCE = 0.1e-3  # meters
# A wrong feature is off by so many of its expanded uncertainties, which are its tolerance.
OFF = 3.0
_DATUMS = 3  # planes that determine a pose


@dataclass(frozen=True, kw_only=True)
class Judged:
    """
    Result of an inspection.

    failed : names of surfaces and features that fail
    able : verdicts of those whose U is below a third of the tolerance
    coverage : fraction of the area that decides
    values : deviation and U, meters, of the diameters and positions
    sizes : U of a diameter, or of the surface of a plane, by the name of the feature
    """

    name: str
    seed: int
    failed: list[str]
    able: list[str]
    coverage: float
    values: list[tuple[float, float]]
    sizes: dict[str, float]

    def candidates(self, number: int) -> list[str]:
        """Return the features that a wrong part may have off: diameters, or planes without any."""
        diameters = [name for name in self.sizes if not name.startswith('plane')]
        names = sorted(diameters or self.sizes)
        first = number // len(PARTS) % len(names)
        return names[first:] + names[:first]


def right_part(number: int) -> Judged:
    """Scan and inspect a right part: the parts in turn."""
    name = list(PARTS)[number % len(PARTS)]
    return inspected(name, PARTS[name](), FIRST_RIGHT + number // len(PARTS))


def wrong_part(numbered: tuple[int, Judged]) -> tuple[str, Judged]:
    """
    Scan and inspect a part with one feature off by ``OFF`` of its U.

    A diameter has the tolerance U and is off by 3 U. A plane exceeds its tolerance by 3 U, and the
    part is aligned by three other planes: a best fit would share the error out among all of them.

    numbered : a number, and the inspection of the right part
    returns : the name of the feature, and the inspection
    """
    number, reference = numbered
    nominal = PARTS[reference.name]()
    seed = FIRST_WRONG + number
    for feature in reference.candidates(number):
        U = reference.sizes[feature]
        if not feature.startswith('plane'):
            made = with_feature_off(nominal, feature, OFF * U)
            tolerances = {feature: {'diameter': U}}
            return feature, inspected(reference.name, nominal, seed, made, tolerances)
        datums = perpendicular_planes(nominal, feature, list(reference.sizes))
        if len(datums) == _DATUMS:
            made = with_feature_off(nominal, feature, TOLERANCE + OFF * U)
            return feature, inspected(reference.name, nominal, seed, made, datums=datums)
    raise ValueError(f'{reference.name}: no feature can be off')


def inspected(
    name: str,
    part: Solid,
    seed: int,
    made: Solid | None = None,
    features: Mapping[str, Mapping[str, float]] | None = None,
    datums: Sequence[str] = (),
) -> Judged:
    """
    Scan and inspect a part.

    part : the nominal
    made : what was scanned, if it is another
    features : tolerances of single features
    datums : features by which the mesh is aligned; none: best fit
    """
    scanned = name if made is None else f'{name} wrong'
    mesh, cell = mesh_of(scanned, made or part, seed)
    placed = part.moved(placement(seed))
    nominal = MeshBody(vertices_xyz=placed.vertices_xyz, faces=placed.faces, closed=True)
    settings = InspectSettings(tolerance=TOLERANCE, features=features or {})
    alignment = align_features(mesh, nominal, datums, settings) if datums else None
    return _judged(name, seed, inspect(mesh, nominal, settings, cell, alignment))


def _judged(name: str, seed: int, found: Inspection) -> Judged:
    surfaces = [found.whole, *found.regions]
    items = [(f, item) for f in found.features for item in f.characteristics]
    failed = [surface.name for surface in surfaces if surface.verdict == 'fail']
    failed += [f.name for f, item in items if item.verdict == 'fail']
    able = [s.verdict for s in surfaces if 3.0 * s.budget.expanded <= s.tolerance and s.coverage]
    able += [i.verdict for _, i in items if 3.0 * i.budget.expanded <= i.tolerance]
    sizes = {f.name: i.budget.expanded for f, i in items if i.name == 'diameter'}
    planes = {f.name for f in found.features if f.nominal.kind == 'plane' and f.feature}
    sizes |= {s.name: s.budget.expanded for s in found.regions if s.name in planes}
    return Judged(
        name=name,
        seed=seed,
        failed=sorted(set(failed) - {'all'}) or [name for name in failed if name == 'all'],
        able=able,
        coverage=found.whole.coverage,
        values=[
            (i.deviation, i.budget.expanded)
            for _, i in items
            if i.name in {'diameter', 'position'}
        ],
        sizes=sizes,
    )
