# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Faults of a scan: how often one passes as OK although the shape is wrong.

Slips of the table in mid-sweep, on rendered scans with one laser (whose sweep exceeds the turn)
and with two. Extracted stripes are cached under build/, so that the first run takes longer.
"""

from collections.abc import Iterator
from itertools import product

from support import slip_cases as cases
from support.rendered_stripes import render

from bench import at_least
from bench import at_most
from bench import Number
from bench.pool import mapped

SEEDS = 20
GOOD_SEEDS = 10


def run() -> Iterator[Number]:
    mapped(render, cases.all_jobs())
    yield from slips()
    yield from good_scans()


def slips() -> Iterator[Number]:
    """One slip of 0.5 to 20 degrees, at a random moment."""
    for name, lasers in product(cases.PARTS, (1, 2)):
        found = mapped(cases.slipped, [(name, lasers, seed) for seed in range(SEEDS)])
        title = f'slip: {name}, {lasers} laser{"s" * (lasers > 1)}'
        wrong = [one for one in found if one.wrong]
        missed = [one for one in wrong if one.code == 'OK']
        note = f'of {SEEDS} seeds, {len(wrong)} with a wrong shape; ' + (
            ', '.join(f'{one.degrees:+.1f} at {one.after}' for one in missed) or 'none'
        )
        yield Number(f'{title}, OK and wrong', len(missed), '', at_most(0), note)
        said = sum(one.code == 'SLIPPED' for one in wrong)
        note = f'the others are UNCHECKED or NOT_CONVERGED: {len(wrong) - len(missed) - said}'
        yield Number(f'{title}, wrong and SLIPPED', said, '', note=note)
        errors = [one.size_error for one in found if one.size_error is not None]
        if errors:
            note = f'{len(errors)} whose size was found'
            yield Number(f'{title}, worst error of the size', max(errors), 'deg', note=note)


def good_scans() -> Iterator[Number]:
    """Scans without a slip stay OK; one laser may be UNCHECKED where its closure is round."""
    for name, lasers in product((*cases.PARTS, *cases.ROUND), (1, 2)):
        codes = mapped(cases.good, [(name, lasers, seed) for seed in range(GOOD_SEEDS)])
        fine = sum(code in ('OK', 'UNCHECKED') for code in codes)
        note = f'of {GOOD_SEEDS} seeds; UNCHECKED: {codes.count("UNCHECKED")}'
        title = f'no slip: {name}, {lasers} laser{"s" * (lasers > 1)}, no false alarm'
        yield Number(title, fine, '', at_least(GOOD_SEEDS), note)
