# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Faults: how often a scan says OK although its shape is wrong, how soon the others are noticed.

Rendered scans with slips, camera stalls and clock jumps (``support.rendered_cell``; extracted
stripes are cached under build/, so that the first run takes longer). Then a cell of real
processes: each fault of ``support.fault_cases``, and sequences of two events drawn by a seed. The
rows of the latter are written to build/bench/faults/, from which the page of the documentation is
made. What was measured with the same sources before is not measured again (``bench.kept``).
"""

from collections.abc import Iterator
from itertools import product

from support import rendered_faults as rendered
from support.rendered_stripes import render

from bench import at_least
from bench import at_most
from bench import fault_matrix
from bench import Number
from bench.kept import kept
from bench.pool import mapped

SEEDS = 20
GOOD_SEEDS = 5
LASERS = (1, 2)


def run() -> Iterator[Number]:
    names = (*rendered.parts(), rendered.ROUND)
    mapped(render, [job for name in names for job in rendered.jobs(name)])
    for name, lasers in product(names, LASERS):
        yield good_scans(name, lasers)
    for kind, lasers in product(rendered.KINDS, LASERS):
        yield from faults(kind, lasers)
    yield from fault_matrix.run()


def good_scans(name: str, lasers: int) -> Number:
    """Scans without a fault are OK; what no check can see is said beside OK."""
    cases = [rendered.Case(name, lasers, 'slip', seed) for seed in range(GOOD_SEEDS)]
    codes = mapped(_good, cases)
    fine = sum(code.partition(':')[0] in ('OK', 'UNCHECKED') for code in codes)
    said = sorted({code for code in codes if code != 'OK'})
    note = f'of {GOOD_SEEDS} seeds; ' + ('; '.join(said) or 'all plain OK')
    title = f'no fault: {name}, {_lasers(lasers)}, no false alarm'
    return Number(title, fine, '', at_least(GOOD_SEEDS), note)


def faults(kind: str, lasers: int) -> Iterator[Number]:
    """One fault at a random moment, the seeds in turn on all parts."""
    found = mapped(_scanned, [rendered.case_of(lasers, kind, seed) for seed in range(SEEDS)])
    silent = [one for one in found if one.silent]
    codes = [one.said.partition(':')[0] or 'OK' for one in found]
    counts = ', '.join(f'{code} {codes.count(code)}' for code in sorted(set(codes)))
    wrong = sum(bool(one.wrong) for one in found)
    note = f'of {SEEDS} seeds on {", ".join(rendered.parts())}: {counts}; {wrong} wrong shapes'
    if silent:
        note += '; silent: ' + ', '.join(map(_named, silent))
    title = f'{kind}, {_lasers(lasers)}'
    yield Number(f'{title}, OK without a word and wrong', len(silent), '', at_most(0), note)
    errors = [one.size_error for one in found if one.size_error is not None]
    if errors:
        note = f'{len(errors)} whose size was found'
        yield Number(f'{title}, worst error of the size', max(errors), 'deg', note=note)


def _good(case: rendered.Case) -> str:
    return kept(f'good {case}', lambda: rendered.good(case))


def _scanned(case: rendered.Case) -> rendered.Found:
    return kept(f'fault {case}', lambda: rendered.scanned(case))


def _lasers(count: int) -> str:
    return f'{count} laser{"s" * (count > 1)}'


def _named(one: rendered.Found) -> str:
    """Return part, size (degrees or seconds) and moment (share of the scan) of a fault."""
    return f'{one.case.part} {one.size:+.2f} at {one.at:.2f}'
