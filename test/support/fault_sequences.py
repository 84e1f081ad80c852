# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Two events in one scan, drawn by a seed: faults in a row, requests while something begins or ends.

A request that is answered OK has to do what it says: a scan that was cancelled does not end as OK,
and one that was paused was PAUSED, unless a fault ended it before.
"""

from collections.abc import Callable
from functools import partial
import math
import signal
import time
from typing import NamedTuple

import numpy as np

from support.fault_cases import frozen
from support.fault_cases import start_while_recorder_closes
from support.fault_cell import FaultCell
from support.fault_cell import FINAL
from support.fault_effects import await_result
from support.fault_effects import Baselines
from support.fault_effects import next_code
from support.fault_effects import observe
from support.fault_effects import reach
from support.fault_effects import repair
from support.fault_effects import SHORT
from support.fault_effects import start

# Longest time between the two events, seconds.
_LONGEST_S = 1.5
REQUESTS = ('cancel', 'pause', 'resume', 'start_scan')
FAULTS: dict[str, Callable[[FaultCell], object]] = {
    'slip of 5 degrees': partial(FaultCell.controller_fault, text='slip 5'),
    'alarm 3': partial(FaultCell.controller_fault, text='alarm 3'),
    'controller reset': partial(FaultCell.controller_fault, text='reset'),
    'silence of 1 s': partial(FaultCell.controller_fault, text='silence 1'),
    'cable pulled': partial(FaultCell.controller_fault, text='unplug'),
    'clock + 10 s': partial(FaultCell.set_clock, seconds=10.0),
    'camera stands 0.7 s': partial(frozen, 'camera', 0.7),
    'recorder stands 0.7 s': partial(frozen, 'recorder', 0.7),
    'triangulator stands 2.5 s': partial(frozen, 'triangulator', 2.5),
    'mesher killed': partial(FaultCell.signal, node='mesher', number=signal.SIGKILL),
    'turntable killed': partial(FaultCell.signal, node='turntable', number=signal.SIGKILL),
}
_STAGES = ('starting', 'scanning', 'last profiles', 'registering', 'meshing', 'finishing')
CLOSING = 'recorder closes a recording made by hand'


class Sequence(NamedTuple):
    """What a seed draws: the stage of the first event, and the seconds to the second."""

    stage: str
    first: str
    pause_s: float
    second: str

    @property
    def name(self) -> str:
        return f'{self.first}, {self.pause_s:.1f} s later {self.second}'


class Outcome(NamedTuple):
    """
    What became of a sequence.

    wrong : what must not be, '' for nothing
    said : codes of the scans, and the answers to requests
    """

    sequence: Sequence
    wrong: str
    said: str
    next_code: str


# Something that begins while something ends.
COLLISIONS = (
    Sequence('registering', 'cancel', 0.0, 'start_scan'),
    Sequence('meshing', 'cancel', 0.0, 'start_scan'),
    Sequence('finishing', 'start_scan', 0.3, 'start_scan'),
    Sequence('last profiles', 'pause', 0.0, 'cancel'),
    Sequence('last profiles', 'pause', 1.0, 'resume'),
    Sequence('starting', CLOSING, 0.0, 'start_scan'),
)


def drawn(seed: int) -> Sequence:
    """Return the sequence of a seed: two faults in a row, or a request and a fault or another."""
    rng = np.random.default_rng((26, seed))
    requests, faults = list(REQUESTS), list(FAULTS)
    stage = str(rng.choice(_STAGES))
    # every second time both come at once
    pause_s = float(rng.uniform(0.0, _LONGEST_S)) * int(rng.integers(2))
    if seed % 2:
        first, second = (str(name) for name in rng.choice(faults, 2, replace=False))
    else:
        first, second = str(rng.choice(requests)), str(rng.choice(requests + faults))
    return Sequence(stage, first, pause_s, second)


def run_sequence(cell: FaultCell, baselines: Baselines, sequence: Sequence) -> Outcome:
    """Run a scan with the two events, then one without."""
    cell.ensure()
    baselines.take(SHORT)
    cell.find_processes()
    if sequence.first == CLOSING:
        start_while_recorder_closes(cell)
    start_s = time.monotonic()
    scan_id = start(cell, SHORT)
    answers: list[tuple[str, bool, str, str]] = []
    begin_s = start_s
    if reach(cell, scan_id, sequence.stage):
        begin_s = time.monotonic()
        _happen(cell, sequence.first, answers)
        cell.client.wait(lambda: False, sequence.pause_s)
        _happen(cell, sequence.second, answers)
    _resume_if_paused(cell, scan_id)
    effect = observe(cell, baselines, scan_id, SHORT, start_s, begin_s)
    others = _others(cell, answers, scan_id)
    states = {
        values.get('stage') for _, values in cell.client.states if values.get('scan_id') == scan_id
    }
    wrong = [
        'no result was published' * (not effect.code),
        'OK without a word and a wrong shape' * (effect.wrong and not effect.detail),
        f'{effect.lost} acknowledged profiles are lost' * bool(effect.lost),
        'the beam is on' * (effect.beam_off_s == math.inf),
        *_unkept(answers, scan_id, effect.code, states),
        *(f'the second scan ended as {code or "nothing"}' for code in others if code == ''),
    ]
    said = [f'scan: {effect.code}', *(f'second scan: {code}' for code in others)]
    said += [f'{name}: {code}' for name, _, code, _ in answers]
    repair(cell, plug='cable pulled' in (sequence.first, sequence.second))
    code = next_code(cell, baselines)
    return Outcome(sequence, '; '.join(filter(None, wrong)), ', '.join(said), code)


def _happen(cell: FaultCell, event: str, answers: list[tuple[str, bool, str, str]]) -> None:
    if event in REQUESTS:
        answers.append((event, *cell.client.ask(event)))
    elif event in FAULTS and cell.running:
        FAULTS[event](cell)


def _resume_if_paused(cell: FaultCell, scan_id: str) -> None:
    """Resume a scan that is or will be paused: at once, or when it has come to its end."""
    client = cell.client

    def stands() -> bool:
        return client.state(scan_id).get('stage') in ('PAUSED', *FINAL) or not cell.running

    client.wait(stands, 60.0)
    if client.state(scan_id).get('stage') == 'PAUSED':
        client.ask('resume')


def _others(cell: FaultCell, answers: list[tuple[str, bool, str, str]], scan_id: str) -> list[str]:
    """Return the codes of further scans that were accepted."""
    found = [own for _, success, _, own in answers if success and own not in ('', scan_id)]
    return [await_result(cell, own) for own in dict.fromkeys(found)]


def _unkept(
    answers: list[tuple[str, bool, str, str]], scan_id: str, code: str, states: set[str | None]
) -> list[str]:
    """Return the requests that were answered OK and did nothing."""
    kept = [name for name, success, _, own in answers if success and own == scan_id]
    found = []
    if 'cancel' in kept and code == 'OK':
        found.append('cancel was answered OK, and the scan ended as OK')
    if 'pause' in kept and 'resume' not in kept and code == 'OK' and 'PAUSED' not in states:
        found.append('pause was answered OK, and the scan was never PAUSED')
    return found
