# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Bench of the inspection: rendered scans of right and wrong parts, and of holes, pins, grooves.

No constant of the inspection was chosen with the parts, seeds and calibrations of this bench. They
were chosen on other parts (holes, pins and grooves of other sizes, a shaft, a block) and seeds.
``IVFMC_BENCH_SCANS`` limits the number of scans of each table; the notes state how many were used.
"""

from collections.abc import Iterator
import os

import numpy as np

from bench import at_least
from bench import at_most
from bench import inspection_cells
from bench import inspection_features
from bench import inspection_judging
from bench import Number
from bench.inspection_judging import Judged
from bench.inspection_judging import OFF
from bench.inspection_judging import TOLERANCE
from bench.inspection_parts import PARTS
from bench.pool import mapped

# Scans of right parts, and of wrong ones: five of each of four parts; and of holes, pins, grooves.
SCANS, FEATURE_SCANS = 20, 200


def limited(scans: int) -> int:
    """Return the number of scans of a table that is taken."""
    return min(int(os.environ.get('IVFMC_BENCH_SCANS', scans)), scans)


def run() -> Iterator[Number]:
    # the bench loads this module by its path, so that functions for other processes are elsewhere
    right = mapped(inspection_judging.right_part, range(limited(SCANS)))
    yield from right_numbers(right)
    yield from wrong_numbers(mapped(inspection_judging.wrong_part, list(enumerate(right))))
    yield from inspection_features.run(limited(FEATURE_SCANS))
    yield from inspection_cells.run()


def right_numbers(judged: list[Judged]) -> Iterator[Number]:
    """Nothing of a right part may fail; what is measured well has to pass."""
    note = f'{len(judged)} scans of {", ".join(PARTS)}, tolerance {TOLERANCE * 1e3:g} mm'
    failed = [f'{each.name} {each.seed}: {name}' for each in judged for name in each.failed]
    shown = f'{note}; {", ".join(failed)}' if failed else note
    yield Number(
        'right parts, surfaces and features that fail', len(failed), '', at_most(0), shown
    )
    able = [verdict for each in judged for verdict in each.able]
    passed = sum(verdict == 'pass' for verdict in able)
    note = f'{passed} of {len(able)} surfaces and features with U below a third of the tolerance'
    yield Number(
        'right parts, passed', 100.0 * passed / max(len(able), 1), '%', at_least(80), note
    )
    coverage = [each.coverage for each in judged]
    note = f'{100 * min(coverage):.0f} to {100 * max(coverage):.0f} % of the area of the part'
    yield Number('right parts, coverage', 100.0 * float(np.mean(coverage)), '%', None, note)
    off = [(value, U) for each in judged for value, U in each.values]
    held = sum(abs(value) <= U for value, U in off)
    note = f'{held} of {len(off)} diameters and positions within U'
    yield Number('right parts, values within U', 100.0 * held / len(off), '%', at_least(95), note)


def wrong_numbers(judged: list[tuple[str, Judged]]) -> Iterator[Number]:
    """One feature of each part is off by 3 U; it has to fail, and nothing else."""
    missed = [f'{each.name} {each.seed}: {f}' for f, each in judged if f not in each.failed]
    others = [
        f'{each.name} {each.seed}: {name}'
        for feature, each in judged
        for name in each.failed
        if name != feature
    ]
    found = len(judged) - len(missed)
    note = '; '.join([f'of {len(judged)} scans, off by {OFF:g} U', *missed])
    yield Number('wrong feature found', found, '', at_least(0.95 * len(judged)), note)
    note = ', '.join(others)
    yield Number('right features of wrong parts that fail', len(others), '', at_most(0), note)
