# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Hardware: motion controllers, cameras, their faults, the guard of the beam, the trigger.

All controllers are emulated on pseudo-terminals, and cameras below OpenCV, in real time: the group
takes some half an hour, most of it for cells that are killed, and other work on the computer shows
in its times.
"""

from collections.abc import Callable
from collections.abc import Iterator
import math
from pathlib import Path
import re
import signal
import tempfile
import time

from hypothesis import given
import numpy as np
from support import controller_faults as faults
from support import controller_features as features
from support.beam_kills import beam_off_after_kill
from support.beam_kills import cell_for_kills
from support.beam_kills import KillCell
from support.beam_kills import KILLED_PARTS
from support.camera_faults import CAMERA_FAULTS
from support.camera_faults import camera_outcome
from support.controllers import connected
from support.controllers import emulated
from support.controllers import FIRMWARES
from support.driver_process import driving
from support.line_fuzz import check_all
from support.line_fuzz import CHECKS
from support.line_fuzz import fuzz_settings
from support.line_fuzz import lines

from bench import at_least
from bench import at_most
from bench import Number
from bench import trigger_rows

FUZZ_LINES = 100_000
KILLS = 20
# Firmwares in turn, with a laser on; a move of FabScan cannot be interrupted, so it stands.
KILLED = (('grbl', 'moving'), ('grblhal', 'lit'), ('horus', 'moving'), ('fabscan', 'lit'))
MOVES, TURNS = 1000, 100
# A table that is ten times as fast as that of the bench cell, so that 100 turns take minutes.
FAST = {110: 72_000.0, 120: 36_000.0}


def run() -> Iterator[Number]:
    yield from controllers()
    yield from controller_faults()
    yield from refusals()
    yield from camera_faults()
    yield from kills()
    yield from fuzzing()
    yield from many_moves()
    yield from trigger_rows.angles()
    yield from trigger_rows.faults()
    yield from trigger_rows.slips()


def controllers() -> Iterator[Number]:
    """Firmware by feature: connects, moves, lights, stops, recovers, homes."""
    for firmware in FIRMWARES:
        failed = []
        for name, check in features.FEATURES.items():
            failed += _failure(
                name, lambda check=check, firmware=firmware: _on_rig(check, firmware)
            )
        failed += _failure('homes', lambda firmware=firmware: _in_folder(features.homes, firmware))
        number = len(features.FEATURES) + 1
        note = '; '.join(failed) or ', '.join([*features.FEATURES, 'homes'])
        if firmware in features.WITHOUT_HOME:
            note += ' (refused: no home switch)'
        title = f'{features.NAMES[firmware]}: features'
        yield Number(title, number - len(failed), f'of {number}', at_least(number), note)


def controller_faults() -> Iterator[Number]:
    """Fault by fault: seconds until the driver says its code and the beam is off."""
    for case in faults.CASES:
        with tempfile.TemporaryDirectory() as folder:
            found = faults.outcome(case, Path(folder))
        how = 'by itself' if case.automatic else 'by clear_alarm'
        good = found.good and found.code in case.codes
        note = f'{found.code or "no fault"}; ready {found.recovered_s:.1f} s later {how}; '
        note += 'next move and laser work' if good else f'BAD, expected {" or ".join(case.codes)}'
        # a case that went wrong has no time
        seconds = found.dark_s if good else math.nan
        yield Number(f'{case.name}: code said, beam off', seconds, 's', at_most(2.0), note)


def refusals() -> Iterator[Number]:
    """Controllers that cannot be connected: seconds until the error, which names the cause."""
    for case in ('taken', 'wrong controller', 'wrong baud rate'):
        with tempfile.TemporaryDirectory() as folder:
            start = time.monotonic()
            error = faults.refused(Path(folder), case)
        seconds = time.monotonic() - start if error else math.nan
        # without the path of the temporary folder
        note = re.sub(r'/\S*/controller', 'PORT', error)
        yield Number(f'{case}: refused', seconds, 's', at_most(15.0), note)


def camera_faults() -> Iterator[Number]:
    """Fault by fault of a USB camera, emulated below OpenCV: seconds until the driver says it."""
    for fault in CAMERA_FAULTS:
        with tempfile.TemporaryDirectory() as folder:
            found = camera_outcome(fault, Path(folder))
        good = found.recovered_s < math.inf
        after = (
            f'next picture {found.recovered_s:.1f} s later' if good else 'BAD, no picture later'
        )
        note = f'{found.text or "no fault"}; {after}'
        yield Number(f'{fault.name}: said', found.said_s, 's', at_most(2.0), note)


def kills() -> Iterator[Number]:
    """SIGKILL and SIGSTOP while a laser is on: seconds until it is off."""
    for number in (signal.SIGKILL, signal.SIGSTOP):
        seconds = [_killed(*KILLED[index % len(KILLED)], number) for index in range(KILLS)]
        yield from _kill_rows('driver', number, seconds, 'of four firmwares in turn')
    with cell_for_kills() as cell:
        for part, note in KILLED_PARTS.items():
            for number in (signal.SIGKILL, signal.SIGSTOP):
                seconds, ended = _kills_in_scans(cell, part, number)
                yield from _kill_rows(part, number, seconds, note)
                title = f'{number.name} of the {part}: scans that ended before it'
                yield Number(title, ended, 'scans', at_most(0), 'another one was begun instead')


def _kills_in_scans(cell: KillCell, part: str, number: signal.Signals) -> tuple[list[float], int]:
    """Return the seconds of each kill, and how many scans ended before they could be killed."""
    seconds: list[float] = []
    ended = 0
    while len(seconds) < KILLS and ended < KILLS:
        measured = beam_off_after_kill(cell, part, number)
        if math.isnan(measured):
            ended += 1
        else:
            seconds.append(measured)
    return seconds, ended


def _kill_rows(
    part: str, number: signal.Signals, seconds: list[float], note: str
) -> Iterator[Number]:
    name = f'{number.name} of the {part}: beam off'
    within = sum(value < 1.0 for value in seconds)
    yield Number(f'{name} within 1 s', within, f'of {KILLS}', at_least(KILLS), note)
    # a beam that did not shine at the kill is no time
    is_measured = seconds and not any(map(math.isnan, seconds))
    slowest = max(seconds) if is_measured else math.nan
    yield Number(f'{name}, slowest', slowest, 's', at_most(1.0))


def fuzzing() -> Iterator[Number]:
    """Lines that raised, hung, or passed for an ok."""
    for name, check in CHECKS.items():
        checked: list[int] = []
        failed = _failure(name, _fuzzing_of(check, checked))
        note = failed[0] if failed else 'no exception, no hang, no false ok'
        yield Number(f'fuzzing of {name}: lines', sum(checked), '', at_least(FUZZ_LINES), note)


def _fuzzing_of(check: Callable[[str], None], checked: list[int]) -> Callable[[], None]:
    """Return a function that checks random lines, and notes how many passed."""

    @fuzz_settings(FUZZ_LINES)
    @given(lines())
    def run_lines(texts: list[str]) -> None:
        check_all(check, texts)
        checked.append(len(texts))

    return run_lines


def many_moves() -> Iterator[Number]:
    """A thousand moves of random size over a hundred turns: steps from the true position."""
    rng = np.random.default_rng(0)
    sizes = rng.dirichlet(np.ones(MOVES)) * TURNS * 2 * math.pi
    # whole turns are whole steps: the last target is anywhere
    sizes[-1] += rng.uniform(0.0, 2 * math.pi)
    worst, start = 0.0, time.monotonic()
    with tempfile.TemporaryDirectory() as folder, connected('grbl', Path(folder)) as rig:
        rig.emulator.machine.settings.update(FAST)
        rig.controller.clear_alarm()
        target = rig.controller.poll().position
        for size in sizes:
            target += float(size)
            rig.controller.move_to(target, 20.0, 600.0)
            rig.arrive()
            worst = max(worst, abs(rig.true_position() - target))
        error = rig.true_position() - target
    step = 2 * math.pi / (360 * rig.emulator.machine.settings[100])
    note = f'{time.monotonic() - start:.0f} s; greatest after any move {worst / step:.3f} steps'
    title = f'{MOVES} moves over {TURNS} turns: final position'
    yield Number(title, abs(error) / step, 'steps', at_most(0.5), note)


def _killed(firmware: str, state: str, number: signal.Signals) -> float:
    with tempfile.TemporaryDirectory() as folder, emulated(firmware, Path(folder)) as emulator:

        def shining() -> bool:
            outputs = emulator.machine.present_outputs()
            return outputs.spindle > 0.0 or outputs.coolant > 0.0

        with driving(Path(folder) / 'controller', firmware, state) as (process, _):
            if not shining():
                return math.nan
            process.send_signal(number)
            start = time.monotonic()
            while shining() and time.monotonic() - start < 5.0:
                time.sleep(0.002)
            return time.monotonic() - start


def _on_rig(check: Callable[[object], None], firmware: str) -> None:
    with tempfile.TemporaryDirectory() as folder, connected(firmware, Path(folder)) as rig:
        check(rig)


def _in_folder(check: Callable[[str, Path], None], firmware: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        check(firmware, Path(folder))


def _failure(name: str, check: Callable[[], None]) -> list[str]:
    """Return what failed, nothing if it passed."""
    try:
        check()
    except Exception as error:
        # whatever a feature or a parser raises is its failure, and the group goes on
        return [f'{name} FAILED: {type(error).__name__}: {str(error)[:80]}']
    return []
