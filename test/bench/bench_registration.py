# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Registration bench: errors of cell and table, degenerate parts, bunny, clampings, cost.

All scans are rendered, one per part (or clamping) for all seeds; a seed sets the errors of table,
axis and laser plane, and the slips. Extracted stripes are cached under build/, so that the first
run takes longer. Seeds run in parallel, times are measured without other load.
"""

from collections.abc import Iterator
from itertools import product

import numpy as np
from support import registration_parts as parts
from support.registration_bunny import alike
from support.registration_bunny import apart
from support.registration_bunny import bunny_folder
from support.registration_bunny import displaced
from support.registration_bunny import Judge
from support.registration_bunny import load_bunny
from support.registration_bunny import mean_poses
from support.registration_bunny import multiway
from support.registration_bunny import ours
from support.registration_bunny import ours_from
from support.registration_cost import exponents
from support.rendered_stripes import render

from bench import at_least
from bench import at_most
from bench import Number
from bench.pool import alone
from bench.pool import mapped

SEEDS = 20
TIMED = 3  # starts of the bunny at which both are timed and compared
_PARTS = ('axis', 'left', 'right')


def run() -> Iterator[Number]:
    mapped(render, parts.all_jobs(SEEDS))
    yield from cost()
    yield from placings()
    yield from bunny()
    yield from two_lasers()
    yield from known_angle()
    yield from blind_order()
    yield from eight_sweeps()
    yield from free_directions()
    yield from clampings()


def two_lasers() -> Iterator[Number]:
    """Errors of angle, backlash, axis and one plane: share of the shape error that is left."""
    for name in parts.REFINED:
        found = mapped(parts.refined, [(name, seed) for seed in range(SEEDS)])
        shares = [one.left for one in found]
        note = f'{SEEDS} seeds, {parts.STEPS} pictures a turn; refine {", ".join(parts.GROUPS)}'
        yield from shares_left(name, shares, note)
        exact = [one.exact for one in found]
        title = f'{name}: error left if what the data tell clearly had no noise'
        yield Number(f'{title}, worst', max(exact), '', note=over_half(exact))
        yield Number(f'{title}, median', float(np.median(exact)), '')
        for kind, is_kind in (('angle', False), ('axis and planes', True)):
            pulls = [
                (pull.size, pull.name)
                for one in found
                for pull in one.pulls
                if pull.name.startswith(_PARTS) == is_kind
            ]
            size, worst = max(pulls, default=(0.0, 'none'))
            note = f'{len(pulls)} observed in {SEEDS} seeds; {worst}'
            title = f'{name}: worst error over claimed sigma, {kind}'
            yield Number(title, size, '', at_most(3.0), note)


def shares_left(name: str, shares: list[float], note: str) -> Iterator[Number]:
    title = f'{name}: error left, worst'
    yield Number(title, max(shares), '', at_most(0.5), over_half(shares))
    yield Number(f'{name}: error left, median', float(np.median(shares)), '', at_most(0.35), note)


def over_half(shares: list[float]) -> str:
    over = ', '.join(f'seed {k}: {share:.2f}' for k, share in enumerate(shares) if share > 0.5)
    return over or 'none above 0.5'


def known_angle() -> Iterator[Number]:
    """The flange on a table without errors: axis depth and table angle are separable."""
    shares = mapped(parts.known_angle, range(SEEDS))
    note = f'{SEEDS} seeds; refine axis, lasers'
    yield from shares_left('flange, angle of the table known', shares, note)


def blind_order() -> Iterator[Number]:
    """Lasers at +-30 degrees do not observe an error of order 6."""
    found = mapped(parts.blind_order, range(SEEDS))
    note = f'coefficients of order 6 that {SEEDS} seeds claim to observe'
    claimed = sum(one for one, _ in found)
    yield Number('lasers at 30 degrees: order 6 claimed', claimed, '', at_most(0), note)
    moved = max(one for _, one in found)
    yield Number('lasers at 30 degrees: order 6 moved', moved, 'prior sigma', at_most(0.3))


def free_directions() -> Iterator[Number]:
    """Cylinder, sphere, plate: motions that the surface does not constrain must stay zero."""
    found = mapped(parts.plain, product(parts.PLAIN, range(SEEDS)))
    for index, name in enumerate(parts.PLAIN):
        moved, ratio = zip(*found[SEEDS * index : SEEDS * (index + 1)], strict=True)
        note = f'{SEEDS} seeds, two lasers, table and cell err'
        yield Number(f'{name}: free directions moved', max(moved), 'sigma', at_most(2.0), note)
        yield Number(f'{name}: rms over that of the table', max(ratio), '', at_most(1.02), note)


def eight_sweeps() -> Iterator[Number]:
    """One laser, sweeps that overlap by 30 degrees and slip, a part that is moved once."""
    for name in parts.REFINED:
        shares = mapped(parts.slipped, [(name, seed) for seed in range(SEEDS)])
        note = f'{SEEDS} seeds, {parts.SWEEP_STEPS} pictures a turn'
        yield from shares_left(f'eight sweeps, {name}', shares, note)


def clampings() -> Iterator[Number]:
    """The demo part upright, and lying in any way: right within 0.1 mm, or refused."""
    found = mapped(parts.clamping, range(SEEDS))
    off = [one for one, _ in found if one is not None]
    right = [one for one in off if one <= 1e-4]
    wrong = len(off) - len(right)
    seconds = np.median([one for _, one in found])
    note = f'of {SEEDS} clampings; {SEEDS - len(off)} refused; {seconds:.0f} s each'
    yield Number('merge: right within 0.1 mm', len(right), '', at_least(0.95 * SEEDS), note)
    yield Number('merge: wrong and not refused', wrong, '', at_most(0))
    yield Number('merge: worst of those that are right', 1e3 * max(right, default=np.nan), 'mm')


def placings() -> Iterator[Number]:
    """Incremental registration of one view while the table turns."""
    seconds = alone(parts.placings)
    note = f'worst {1e3 * max(seconds):.0f} ms; sweeps of {parts.SWEEP_STEPS * 75 // 360} profiles'
    yield Number('a view placed, median', 1e3 * float(np.median(seconds)), 'ms', at_most(20), note)


def cost() -> Iterator[Number]:
    yield from alone(_cost)


def _cost() -> list[Number]:
    return list(exponents())


def bunny() -> Iterator[Number]:
    """Ten real scans from displaced starts, against Open3D's multiway registration."""
    scans = load_bunny(bunny_folder())
    judge, timed, theirs, ratios, shares = Judge(scans), [], [], [], []
    for seed in range(TIMED):
        start = displaced(scans, seed)
        our_answer, our_seconds = ours(scans, start)
        their_answer, their_seconds = multiway(scans, start)
        timed.append(our_answer)
        theirs.append(their_answer)
        ratios.append(judge.rms(our_answer) / judge.rms(their_answer))
        shares.append((our_seconds / their_seconds, our_seconds, their_seconds))
    answers = [*timed, *mapped(ours_from, range(TIMED, SEEDS))]
    fewest, off = alike(answers, scans)
    note = f'of {SEEDS}, whichever is compared with; all within {off} of their mean'
    yield Number('bunny: starts that end in the same poses', fewest, '', at_least(19), note)
    note = f'worst of {TIMED} starts; ours {judge.rms(timed[0]) * 1e3:.4f} mm'
    yield Number('bunny: rms over that of multiway', max(ratios), '', at_most(1.0), note)
    share, our_seconds, their_seconds = max(shares)
    note = f'worst of {TIMED} starts; {our_seconds:.1f} s, multiway {their_seconds:.1f} s'
    yield Number('bunny: time over that of multiway', share, '', at_most(0.5), note)
    conf = [scan.pose for scan in scans]
    for name, answer in (('ours', mean_poses(answers, scans)), ('multiway', theirs[0])):
        degrees, meters = apart(answer, conf, scans).max(axis=0)
        yield Number(f'bunny: {name} from bun.conf', degrees, 'deg')
        yield Number(f'bunny: {name} from bun.conf, centroid', meters * 1e3, 'mm')
