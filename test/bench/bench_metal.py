# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Machined metal with inter-reflections: path-traced pictures of the held half, see ``bench.metal``.

Needs the extra ``bench`` (Mitsuba 3) and a libLLVM of version 19 or later, once, for the pictures.
"""

from collections.abc import Iterator
import re
import time

import cv2
import numpy as np

from bench import at_least
from bench import at_most
from bench import Number
from bench.metal import full_turn
from bench.metal import measures
from bench.metal import overlay
from bench.metal import pictures
from bench.metal.materials import MATERIALS
from bench.metal.pictures import HELD
from bench.metal.pictures import KEPT
from bench.metal.scores import FAINT
from bench.metal.scores import Score
from bench.metal.scores import score

SMOOTH = 'smooth aluminium'
MAX_OFF = 0.01  # share of kept points off by more than 0.1 mm
MAX_OFF_SMOOTH = 0.03  # the same on smooth aluminium, which mirrors
OTHERS = {
    'glare off': measures.GLARE_OFF,
    'argmax': measures.ARGMAX,
    'center of mass': measures.MASS,
}
ROUNDS = 15  # of the clock, each picture once


def run() -> Iterator[Number]:
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        for material in MATERIALS:
            pictures.render_all(pictures.shots(HELD, material))
            yield from kept(material)
        yield from full_turn.run(HELD, 'rough aluminium')
        yield clock()
    finally:
        cv2.setNumThreads(threads)


def kept(material: str) -> Iterator[Number]:
    """Points kept, rows found and claimed sigmas of one material."""
    parts = pictures.by_part(pictures.shots(HELD, material))
    ours = _measured(parts, measures.DEFAULT, (1.0,))
    three = _measured(parts, measures.DEFAULT, pictures.BRACKET)
    others = {name: _measured(parts, settings, (1.0,)) for name, settings in OTHERS.items()}
    limit = MAX_OFF_SMOOTH if material == SMOOTH else MAX_OFF

    def note(what: str, unit: float) -> str:
        return ', '.join(f'{name} {unit * getattr(s, what):.3g}' for name, s in others.items())

    count = f'{len(ours.distance)} points; '
    yield Number(
        f'{material}: points off by more than 0.1 mm',
        ours.share_off,
        '',
        at_most(limit),
        count + note('share_off', 1.0),
    )
    yield Number(f'{material}: rms', 1e3 * ours.rms, 'mm', at_most(0.05), note('rms', 1e3))
    yield Number(
        f'{material}: error below 2 sigma',
        ours.within_two_sigma,
        '',
        at_least(0.9),
        note('within_two_sigma', 1.0),
    )
    visible = f'{ours.rows_visible.sum()} of {len(ours.rows_visible)} rows; '
    yield Number(
        f'{material}: lit rows found, one exposure',
        ours.found_of_all,
        '',
        at_least(0.6),
        f'of those above {FAINT:.0f} DN {ours.found:.3g}, which are {visible}'
        + note('found_of_all', 1.0),
    )
    yield Number(
        f'{material}: lit rows found, three exposures',
        three.found_of_all,
        '',
        at_least(0.85),
        f'off by more than 0.1 mm: {three.share_off:.3g}, rms {1e3 * three.rms:.3g} mm, '
        f'below 2 sigma {three.within_two_sigma:.3g}',
    )
    _draw_worst(material, parts)


def clock() -> Number:
    """CPU time of a picture with the search for thin stripes over that without, one thread."""
    shots = pictures.by_part(pictures.shots(HELD, 'rough aluminium'))[0]
    seconds = {}
    factor = pictures.exposure(shots)
    frames = [next(pictures.frames(shot, factor)) for shot in shots]
    ours, before = (measures.Product(shots, s) for s in (measures.DEFAULT, measures.GLARE_OFF))
    for _ in range(ROUNDS):
        for name, product in (('on', ours), ('off', before)):
            start = time.process_time()
            for shot, frame in zip(shots, frames, strict=True):
                product(shot, [frame])
            seconds.setdefault(name, []).append((time.process_time() - start) / len(shots))
    on, off = (1e3 * float(np.median(seconds[name])) for name in ('on', 'off'))
    note = f'{on:.2f} and {off:.2f} ms a profile, medians of CPU time'
    return Number('time of the search for thin stripes / before', on / off, '', at_most(1.5), note)


def _measured(parts, settings, exposures) -> Score:
    return Score.pooled(
        score(shots, measures.Product(shots, settings), exposures) for shots in parts
    )


def _draw_worst(material, parts) -> None:
    """Write the picture of the shot with the most points that are off, then the fewest found."""
    found = []
    for shots in parts:
        product, factor = measures.Product(shots, measures.DEFAULT), pictures.exposure(shots)
        for shot in shots:
            frame = next(pictures.frames(shot, factor))
            profile = product(shot, [frame])
            one = score([shot], lambda *_, profile=profile: profile)
            found.append((np.nan_to_num(one.share_off), -one.found_of_all, len(found)))
            found[-1] += (shot, frame, profile)
    *_, shot, frame, profile = max(found, key=lambda entry: entry[:3])
    name = re.sub('[^a-z]+', '_', material)
    overlay.draw(shot, frame, profile, KEPT.parent / f'metal_{name}.png')
