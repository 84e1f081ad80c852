# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bench: bias and uncertainty of holes, pins and grooves of several sizes."""

from collections import defaultdict
from collections.abc import Iterator

import numpy as np

from bench import at_least
from bench import Number
from bench.inspection_parts import DIAMETERS
from bench.inspection_parts import groove_height
from bench.inspection_parts import plate_with_holes
from bench.inspection_parts import plate_with_pins
from bench.inspection_parts import shaft_with_grooves
from bench.inspection_parts import WIDTHS
from bench.inspection_scans import mesh_of
from bench.inspection_scans import placement
from bench.pool import mapped
from ivfmc_ros.inspection.feature_measurement import FeatureResult
from ivfmc_ros.inspection.inspect import inspect
from ivfmc_ros.inspection.mesh_file import MeshBody
from ivfmc_ros.inspection.settings import InspectSettings

# Seed of the first scan; each part has its own.
_FIRST = 301
_PARTS = {
    'hole': (plate_with_holes, DIAMETERS),
    'pin': (plate_with_pins, DIAMETERS),
    'groove': (shaft_with_grooves, WIDTHS),
}
_SAME = 5e-6  # meters, between a nominal size and that of a region


def run(scans: int) -> Iterator[Number]:
    """
    Measure all sizes in a number of scans: of a groove the diameter at its ground.

    One scan holds all holes, all pins or all grooves; a third of the scans is taken of each.
    """
    rows: dict[tuple[str, float], list[tuple[float, float]]] = defaultdict(list)
    missing: dict[tuple[str, float], int] = defaultdict(int)
    for number, found in enumerate(mapped(features_of_scan, range(scans))):
        kind, sizes = _kind(number)
        for size in sizes:
            measured = _measured(kind, size, found)
            if measured is None:
                missing[kind, size] += 1
            else:
                rows[kind, size].append(measured)
    for kind, (_, sizes) in _PARTS.items():
        for size in sizes:
            yield from _row(kind, size, rows[kind, size], missing[kind, size])
    values = [value for row in rows.values() for value in row]
    if values:
        held = 100.0 * float(np.mean([abs(bias) <= U for bias, U in values]))
        note = f'{len(values)} values of {scans} scans'
        yield Number('holes, pins, grooves: |bias| below U', held, '%', at_least(95), note)


def _row(
    kind: str, size: float, values: list[tuple[float, float]], missing: int
) -> Iterator[Number]:
    name = f'{kind} {size * 1e3:g} mm, bias'
    if not values:
        if missing:
            note = f'not measured well enough in {missing} scans'
            yield Number(name, float('nan'), 'mm', None, note)
        return
    bias, U = np.array(values).T
    note = f'U {np.median(U) * 1e3:.4f} mm, worst {np.abs(bias).max() * 1e3:.4f} mm, '
    note += f'{len(values)} scans, not measured well enough in {missing}'
    yield Number(name, float(bias.mean()) * 1e3, 'mm', None, note)


def _kind(number: int) -> tuple[str, tuple[float, ...]]:
    kind = list(_PARTS)[number % len(_PARTS)]
    return kind, _PARTS[kind][1]


def features_of_scan(number: int) -> list[FeatureResult]:
    """Scan and inspect one of the parts: holes, pins and grooves in turn."""
    kind, _ = _kind(number)
    part, seed = _PARTS[kind][0](), _FIRST + number
    mesh, cell = mesh_of(f'{kind}s', part, seed)
    placed = part.moved(placement(seed))
    nominal = MeshBody(vertices_xyz=placed.vertices_xyz, faces=placed.faces, closed=True)
    return inspect(mesh, nominal, InspectSettings(), cell).features


def _measured(kind: str, size: float, found: list[FeatureResult]) -> tuple[float, float] | None:
    """Return bias and U of a diameter; of a groove, by its width, of that at its ground."""
    for feature in found:
        if not feature.characteristics or feature.nominal.kind != 'cylinder':
            continue
        item = feature.characteristics[0]
        if kind == 'groove':
            same = abs(feature.nominal.center_xyz[2] - groove_height(size)) < _SAME
        else:
            same = abs(feature.nominal.diameter - size) < _SAME
        if same:
            return item.deviation, item.budget.expanded
    return None
