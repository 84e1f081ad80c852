# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Camera triggered by the table: errors of the table angle, and faults of the trigger line."""

from collections import Counter
from collections.abc import Iterator
import math

import numpy as np
from support.triggered import TriggeredSweep

from bench import at_least
from bench import at_most
from bench import Number
from ivfmc_ros.model import Profile
from ivfmc_ros.registration.views.motion_fit import refit
from ivfmc_ros.registration.views.trigger import number_profiles

STEP = math.radians(0.8)
TURNS, SWEEPS = 10, 200
# Seeds of no test.
_SEED = 5000
# Radians: a picture of another step than its own is off by more.
_HALF = 0.5


def angles() -> Iterator[Number]:
    """Angle of each picture in a turn at 24 degrees/s, reports 5 to 20 ms late, 10 a second."""
    reported, fitted, stepped = [], [], []
    for seed in range(TURNS):
        sweep = TriggeredSweep(step=STEP, seed=_SEED + seed)
        measured = sweep.profiles()
        fit, motions = refit(measured)
        found, _ = number_profiles(fit, motions, STEP)
        seqs = {profile.seq for profile in found}
        reported.append(_errors(sweep, [p for p in measured if p.seq in seqs]))
        fitted.append(_errors(sweep, [p for p in fit if p.seq in seqs]))
        stepped.append(_errors(sweep, found))
    note = f'{TURNS} turns, without the constant that turns the whole part'
    for name, errors, bar in (
        ('as reported', reported, None),
        ('without trigger, motion fit', fitted, at_most(0.025)),
        ('with trigger', stepped, at_most(1e-6)),
    ):
        rms = math.degrees(np.sqrt(np.mean(np.concatenate(errors) ** 2)))
        yield Number(f'table angle {name}: rms', rms, 'deg', bar, note)


def faults() -> Iterator[Number]:
    """Random faults of the line: numbering wrong and not said must be 0."""
    counts: Counter[str] = Counter()
    for seed in range(SWEEPS):
        sweep = _random_sweep(seed)
        fit, motions = refit(sweep.profiles())
        found, (motion,) = number_profiles(fit, motions, sweep.step)
        trigger = motion.trigger
        counts['refused'] += bool(trigger.code)
        if trigger.code:
            continue
        off = np.abs(_errors(sweep, found)) / sweep.step
        counts['wrong'] += bool(off.max() > _HALF)
        # a false pulse near a step without one of its own
        counts['near'] += int(np.count_nonzero(off > 1e-6))
        for name in ('kept', 'dropped', 'doubled', 'spurious'):
            counts[name] += getattr(trigger, name)
    said = ', '.join(f'{counts[k]} {k}' for k in ('kept', 'dropped', 'doubled', 'spurious'))
    title = f'triggers with faults, {SWEEPS} sweeps'
    note = f'{said}; {counts["near"]} pictures on a false pulse within 0.25 steps'
    yield Number(f'{title}: wrong number, not said', counts['wrong'], '', at_most(0), note)
    numbered = SWEEPS - counts['refused']
    note = 'others refused by name; up to 20 % dropped, 10 % doubled, some false'
    yield Number(f'{title}: numbered', numbered, f'of {SWEEPS}', at_least(0.95 * SWEEPS), note)


def slips() -> Iterator[Number]:
    """Steps that the table loses against its reports in mid-sweep, by a whole step and less."""
    said = 0
    for seed in range(TURNS):
        lost = STEP * (0.5, 1.0, -1.0, 2.0)[seed % 4]
        sweep = TriggeredSweep(step=STEP, lost=lost, drop=0.05, seed=_SEED + seed)
        fit, motions = refit(sweep.profiles())
        _, (motion,) = number_profiles(fit, motions, STEP)
        said += motion.trigger.code in ('SLIPPED', 'TRIGGER_REFUSED')
    title = 'reports and triggers part by 0.4 to 1.6 deg: said'
    yield Number(title, said, f'of {TURNS}', at_least(TURNS))


def _random_sweep(seed: int) -> TriggeredSweep:
    rng = np.random.default_rng([_SEED, seed])
    return TriggeredSweep(
        step=math.radians(rng.choice([0.9, 0.72, 0.6, 0.45, 0.3])),
        span=math.radians(rng.choice([360, -360, 180, -120, 400])),
        drop=rng.uniform(0.0, 0.2),
        double=rng.uniform(0.0, 0.1),
        noise=rng.uniform(0.0, 1.0) * (seed % 2),
        rate=rng.choice([5.0, 10.0, 50.0]),
        seed=_SEED + seed,
    )


def _errors(sweep: TriggeredSweep, profiles: list[Profile]) -> np.ndarray:
    off = np.array([p.angle for p in profiles]) - sweep.true_angles(profiles)
    return off - np.median(off)
