# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of the faults of a cell of real processes, and the table of them."""

from collections.abc import Iterator
from collections.abc import Sequence
from functools import partial
import json
import math
from pathlib import Path
import re
import sys
import tempfile
import time

from support import fault_cases
from support import fault_sequences
from support.fault_cell import FaultCell
from support.fault_cell import FaultClient
from support.fault_effects import Baselines
from support.fault_effects import Effect
from support.fault_effects import FaultCase
from support.fault_effects import run_case
from support.shared_memory import left_by_the_dead

from bench import at_least
from bench import at_most
from bench import Number
from bench.kept import kept
from ivfmc_ros.files import write_text

SEQUENCES = 20  # that are drawn
TABLES = Path('build/bench/faults')
# Seconds until a fault is noticed, and until the beam is off.
_DETECTION_S, _BEAM_S = 2.0, 1.0
# Code of a fault that could not be measured.
_BROKE = 'BROKE'
MATRIX_HEAD = ('fault', 'stage', 'detected after', 'beam off after', 'what happened', 'next scan')
SEQUENCE_HEAD = ('stage', 'sequence', 'what happened', 'against the rules', 'next scan')


def run() -> Iterator[Number]:
    begin = time.time()
    client = FaultClient()
    try:
        with tempfile.TemporaryDirectory() as name:
            homed = [case for case in fault_cases.all_cases() if case.request['home']]
            others = [case for case in fault_cases.all_cases() if not case.request['home']]
            cell = FaultCell(client, Path(name) / 'matrix')
            effects = matrix(cell, others)
            found = sequences(cell)
            cell.end()
            with_switch = FaultCell(client, Path(name) / 'homing', home_switch=True)
            effects += matrix(with_switch, homed)
            with_switch.end()
    finally:
        client.close()
    orphans = cell.orphans + with_switch.orphans
    yield from figures(effects)
    yield from figures_of_sequences(found)
    yield Number('processes left by cells that ended', orphans, '', at_most(0))
    left = left_by_the_dead(since=begin)
    note = 'of cells that ended before the last one began'
    yield Number('shared memory left for good', left * 1e-6, 'MB', at_most(0), note)


def matrix(cell: FaultCell, cases: Sequence[FaultCase]) -> list[Effect]:
    """Run all cases; one that breaks is a row like any other."""
    baselines, effects = Baselines(cell), []
    for case in cases:
        key = f'{case.name}, {case.stage}'
        effect = kept(key, partial(_effect, cell, baselines, case), lambda one: one.code != _BROKE)
        effects.append(effect)
        _say(matrix_row(effect))
        _write('matrix', MATRIX_HEAD, [matrix_row(one) for one in effects], cell)
    return effects


def _effect(cell: FaultCell, baselines: Baselines, case: FaultCase) -> Effect:
    try:
        return run_case(cell, baselines, case)
    except Exception as error:  # the other faults have to be measured all the same
        cell.end()
        return Effect(case.name, case.stage, _BROKE, _text(error), next_code='not tried')


def sequences(cell: FaultCell) -> list[fault_sequences.Outcome]:
    """Run the sequences of all seeds."""
    baselines, found = Baselines(cell), []
    drawn = [fault_sequences.drawn(seed) for seed in range(SEQUENCES)]
    for sequence in [*fault_sequences.COLLISIONS, *drawn]:
        key = f'{sequence.stage}: {sequence.name}'
        outcome = kept(
            key, partial(_outcome, cell, baselines, sequence), lambda one: bool(one.said)
        )
        found.append(outcome)
        _say(sequence_row(outcome))
        _write('sequences', SEQUENCE_HEAD, [sequence_row(one) for one in found], cell)
    return found


def _outcome(
    cell: FaultCell, baselines: Baselines, sequence: fault_sequences.Sequence
) -> fault_sequences.Outcome:
    try:
        return fault_sequences.run_sequence(cell, baselines, sequence)
    except Exception as error:  # as above
        cell.end()
        return fault_sequences.Outcome(sequence, f'broke: {_text(error)}', '', 'not tried')


def _text(error: Exception) -> str:
    return ' '.join(f'{type(error).__name__}: {error}'.split())[:300]


def figures(effects: Sequence[Effect]) -> Iterator[Number]:
    """Yield the figures of the matrix, the worst case of each in the note."""
    noticed = [effect for effect in effects if effect.stopped]
    yield Number('real processes: faults', len(effects), '', at_least(40))
    late = [one for one in effects if one.code != 'OK' and one.with_result]
    note = ', '.join(sorted({f'{one.fault}: {one.code}' for one in late}))
    yield Number('said with the result of the scan', len(late), '', note=note)
    yield _worst('detected after', noticed, lambda one: one.detected_s, _DETECTION_S)
    hazards = [one for one in noticed if one.hazard]
    yield _worst(
        'beam off after a fault of what controls it', hazards, lambda one: one.beam_off_s, _BEAM_S
    )
    others = [one for one in noticed if not one.hazard]
    yield _worst(
        'beam off after the detection of another fault',
        others,
        lambda one: one.beam_off_s - one.detected_s,
        _BEAM_S,
    )
    slow = max((one.beam_off_s for one in others if math.isfinite(one.beam_off_s)), default=0.0)
    yield Number('beam off after another fault', slow, 's', note='without a bar: no hazard')
    lost = sum(one.lost for one in effects)
    note = '; '.join(f'{one.fault} ({one.stage})' for one in effects if one.lost)
    yield Number('acknowledged profiles lost', lost, '', at_most(0), note)
    for name, said, bar in (('without a word', False, at_most(0)), ('with a doubt', True, None)):
        wrong = [one for one in effects if one.wrong and bool(one.detail) == said]
        note = '; '.join(f'{one.fault} ({one.stage})' for one in wrong)
        yield Number(f'OK {name} and a wrong shape', len(wrong), '', bar, note)
    bad = [one for one in effects if one.next_code != 'OK']
    note = '; '.join(f'{one.fault} ({one.stage}): {one.next_code}' for one in bad)
    yield Number('next scan not good', len(bad), '', at_most(0), note)


def figures_of_sequences(found: Sequence[fault_sequences.Outcome]) -> Iterator[Number]:
    """Yield the figures of the sequences."""
    yield Number('sequences of two events', len(found), '', at_least(SEQUENCES))
    wrong = [one for one in found if one.wrong]
    note = '; '.join(f'{one.sequence.name} ({one.sequence.stage}): {one.wrong}' for one in wrong)
    yield Number('sequences against the rules', len(wrong), '', at_most(0), note)
    bad = [one for one in found if one.next_code != 'OK']
    note = '; '.join(f'{one.sequence.name}: {one.next_code}' for one in bad)
    yield Number('sequences: next scan not good', len(bad), '', at_most(0), note)


def _worst(name: str, effects: Sequence[Effect], value, limit: float) -> Number:
    """Return the figure of the slowest fault; inf where one was not noticed."""
    if not effects:
        return Number(name, math.nan, 's', at_most(limit), 'no such fault')
    seconds = [math.inf if math.isnan(value(one)) else value(one) for one in effects]
    worst = effects[seconds.index(max(seconds))]
    over = sum(not second <= limit for second in seconds)
    note = f'{worst.fault} ({worst.stage}); of {len(effects)}, {over} over the bar'
    return Number(name, max(seconds), 's', at_most(limit), note)


def matrix_row(effect: Effect) -> list[str]:
    """Return a row of the table of faults."""
    what = effect.code or 'nothing was said'
    if effect.detail:
        what = f'{what}: {_short(effect.detail)}'
    if effect.wrong:
        what = f'{what}, with a WRONG shape'
    if effect.lost:
        what = f'{what}; {effect.lost} acknowledged profiles LOST'
    if effect.with_result and effect.code != 'OK':
        what = f'{what} (said with the result)'
    if effect.down:
        what = f'{what}; the cell was taken down'
    seconds = (_seconds(effect.detected_s), _seconds(effect.beam_off_s))
    return [effect.fault, effect.stage, *seconds, what, effect.next_scan]


def sequence_row(outcome: fault_sequences.Outcome) -> list[str]:
    """Return a row of the table of sequences."""
    following = 'good' if outcome.next_code == 'OK' else f'no: {outcome.next_code}'
    stage, name = outcome.sequence.stage, outcome.sequence.name
    return [stage, name, outcome.said, outcome.wrong or 'nothing', following]


def _seconds(value: float) -> str:
    if math.isnan(value):
        return ''
    return 'never' if math.isinf(value) else f'{value:.2f} s'


def _short(text: str) -> str:
    # a table is published: it names no path of this computer
    text = re.sub(rf'{re.escape(tempfile.gettempdir())}/\S*/', 'DIR/', text)
    return text if len(text) <= 120 else f'{text[:117]}...'


def _say(row: Sequence[str]) -> None:
    print('faults: ' + ' | '.join(row), file=sys.stderr, flush=True)


def _write(name: str, head: Sequence[str], rows: Sequence[Sequence[str]], cell: FaultCell) -> None:
    """Write a table after each row: a run takes nearly two hours, and may be ended."""
    TABLES.mkdir(parents=True, exist_ok=True)
    path = TABLES / f'{name}{"_homing" * cell.home_switch}.json'
    write_text(path, json.dumps([list(head), *rows], indent=1) + '\n')
