# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The stripe extractor against the noise limit, ghosts, edges, the clock and real pictures."""

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
from support.real_scan import measured_scan

from bench import at_least
from bench import at_most
from bench import clock as one_thread
from bench import edges
from bench import ghosts
from bench import measured
from bench import Number
from bench import slanted
from bench import stripes
from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.stripe.acquisition import Acquisition
from ivfmc_ros.stripe.acquisition import AcquisitionSettings
from ivfmc_ros.stripe.extract import extract
from ivfmc_ros.stripe.extract import ExtractSettings
from ivfmc_ros.stripe.roi import RegionOfInterest
from ivfmc_ros.stripe.roi import stripe_mask
from ivfmc_ros.stripe.space_time import space_time_profile
from ivfmc_ros.stripe.triangulate import triangulate

PICTURES = 98  # of 1024 rows: 100,352 a case
SPECKLED = one_thread.SPECKLED
CASES = [
    stripes.Case(sigma, height, read)
    for sigma in (1.2, 2.5, 5.0)
    for height in (180.0, 60.0)
    for read in (2.0, 4.0)
]
KEEP_ALL = 50.0  # max_error, max_uncertainty: drop nothing


def run() -> Iterator[Number]:
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        for part in (limit, speckle, sigmas, clock, reference, corners, walls, edge_bias, real):
            # numpy's numbers compare to numpy's truths, which JSON does not know
            yield from (replace(number, value=float(number.value)) for number in part())
    finally:
        cv2.setNumThreads(threads)


def errors(case, settings, count=PICTURES, seed=1):
    """Return the errors (pixels) of all rows found, their sub-pixel phases and the share found."""
    found, phases, rows = [], [], 0
    for image, u in stripes.pictures(case, count, seed):
        stripe = extract(image, settings=settings)
        truth = u[stripe.uv[:, 1].astype(int)]
        found.append(stripe.uv[:, 0] - truth)
        phases.append(truth % 1.0)
        rows += len(u)
    error = np.concatenate(found)
    return error, np.concatenate(phases), len(error) / rows


def bias(error, phase):
    """Return the largest mean error of a tenth of the sub-pixel phases."""
    tenth = (phase * 10).astype(int) % 10
    return max(abs(error[tenth == k].mean()) for k in range(10))


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def limit():
    """The default against the Cramer-Rao bound."""
    ratios, biases, shares, outliers = [], [], [], 0
    for case in CASES:
        error, phase, share = errors(case, ExtractSettings(noise=case.noise))
        least = stripes.bound(case)
        ratios.append(rms(error) / least)
        biases.append(bias(error, phase))
        shares.append(share)
        outliers += int(np.count_nonzero(np.abs(error) > 1.0))
        yield Number(
            f'rms / bound: {case}',
            ratios[-1],
            '',
            at_most(1.05),
            f'{rms(error):.4f} px, bound {least:.4f} px, bias {biases[-1]:.4f} px',
        )
    yield Number('bias, worst tenth of a pixel of all cases', max(biases), 'px', at_most(0.01))
    yield Number('rows found, worst case', min(shares), '', at_least(0.99))
    yield Number('rows off by more than 1 px, all cases', outliers, '', at_most(0))


def speckle():
    """Speckle, where the choice of the estimator matters most."""
    least = stripes.bound(SPECKLED)
    error, phase, _ = errors(SPECKLED, ExtractSettings(noise=SPECKLED.noise))
    note = f'bound {least:.4f} px, bias {bias(error, phase):.4f} px'
    yield Number('speckle: rms of the default', rms(error), 'px', at_most(0.095), note)
    blind = replace(SPECKLED.noise, speckle=0.0, electrons_per_dn=np.inf)
    all_rows = ExtractSettings(noise=SPECKLED.noise, max_error=KEEP_ALL, max_uncertainty=KEEP_ALL)
    others = {'gaussian without weights': replace(all_rows, noise=blind)}
    for method in ('paper', 'centre_of_mass', 'zero_crossing', 'log_gaussian'):
        others[method] = replace(all_rows, method=method)
    for name, settings in others.items():
        error, _, share = errors(SPECKLED, settings, 10)
        yield Number(f'speckle: rms of {name}', rms(error), 'px', note=f'{share:.1%} found')


def sigmas():
    """Claimed sigmas of rendered faces, speckle anew in every picture."""
    scores = slanted.scores()
    for name, values in scores.items():
        ratio = float(np.std(values))
        note = f'{len(values)} points'
        yield Number(f'error / sigma: {name}', ratio, '', at_least(0.8), note)
        yield Number(f'error / sigma: {name}', ratio, '', at_most(1.25), note)


def clock():
    """CPU time per frame over that of argmax, one thread."""
    times = one_thread.times()
    base = times['argmax']
    note = f'{times["default"]:.2f} ms; argmax {base:.3f} ms; medians of CPU time, one thread'
    yield Number('time of the default / argmax', times['default'] / base, '', at_most(25), note)
    yield Number(
        'time with the path search / argmax',
        times['path'] / base,
        '',
        at_most(40),
        'two stripes in every row',
    )
    yield Number('time of a stripe of sigma 5 px / argmax', times['wide'] / base, '')
    yield Number(
        'time of Horus chain / default', times['horus'] / times['default'], '', at_least(2)
    )


def reference():
    """Error of the Horus chain on smooth stripes, which is what its smoothing is for."""
    quiet = replace(SPECKLED, speckle=0.0)
    for name, case, along in (
        ('no speckle', quiet, 0.0),
        ('speckle, both smoothed along the stripe', SPECKLED, 2.0),
        ('speckle, only Horus smoothed', SPECKLED, 0.0),
        ('60 DN', replace(quiet, height=60.0), 0.0),
    ):
        ours, theirs, rows = [], [], 0
        for image, u in stripes.pictures(case, 8, 6, jitter=0.0):
            stripe = extract(image, settings=ExtractSettings(noise=case.noise, along=along))
            ours.append(stripe.uv[:, 0] - u[stripe.uv[:, 1].astype(int)])
            lines, places = stripes.horus(image)
            theirs.append(places - u[lines])
            rows += len(u)
        mine, horus = np.concatenate(ours), np.concatenate(theirs)
        judged = name != 'speckle, only Horus smoothed' and len(horus) > 0.5 * rows
        note = f'{rms(mine):.4f} and {rms(horus):.4f} px, of {len(mine) / rows:.0%} and '
        yield Number(
            f'error of the default / Horus chain: {name}',
            rms(mine) / rms(horus),
            '',
            at_most(0.5) if judged else None,
            note + f'{len(horus) / rows:.0%} of the rows',
        )


def corners():
    """Rows with the right stripe in corners of shiny metal."""
    region = RegionOfInterest.of(stripe_mask(ghosts.CELL, ghosts.LASER, Volume()))
    yield from _right('metal corners', [ghosts.corner(*c, seed=k) for k, c in _CORNERS], region)


def walls():
    """Rows with the right stripe on a dim part before a bright wall."""
    region = RegionOfInterest.of(stripe_mask(ghosts.CELL, ghosts.LASER, Volume()))
    yield from _right('background wall', [ghosts.behind_part(220.0, k) for k in range(4)], region)


# opening, turn (radians), edge on the platter (meters), tilt of the edge (radians)
_CORNERS = list(
    enumerate(
        (
            (1.4, 0.3, (-0.01, 0.010), 0.0),
            (1.4, 0.3, (-0.01, -0.012), 0.0),
            (1.57, 0.3, (-0.01, 0.0), 0.5),
            (1.57, 0.2, (-0.01, 0.015), 0.6),
            (1.8, 0.3, (-0.01, 0.020), 0.9),
            (1.57, 0.3, (-0.01, 0.010), 1.2),
        )
    )
)


def _right(name, pictures, region):
    """Yield the shares of rows with the right stripe, pooled."""
    truth = np.concatenate([picture.truth for picture in pictures])
    choices = {
        'default, nothing dropped': ExtractSettings(max_error=KEEP_ALL, max_uncertainty=KEEP_ALL),
        'default': ExtractSettings(),
        'no path search': ExtractSettings(path=False),
    }
    for choice, settings in choices.items():
        found = np.full(len(truth), np.nan)
        for number, picture in enumerate(pictures):
            stripe = extract(picture.image, settings=settings, region=region)
            rows = stripe.uv[:, 1].astype(int) + number * len(picture.truth)
            found[rows] = stripe.uv[:, 0]
        share = ghosts.right_rows(np.arange(len(truth)), found, truth)
        there = np.isfinite(truth) & np.isfinite(found)
        wrong = np.mean(np.abs(found - truth)[there] >= ghosts.RIGHT)
        bar = at_least(0.98) if choice == 'default, nothing dropped' else None
        note = f'of {np.isfinite(truth).sum()} rows; {wrong:.2%} of those found are wrong'
        yield Number(f'{name}: right rows, {choice}', share, '', bar, note)
    brightest = np.concatenate([picture.image.argmax(axis=1) for picture in pictures])
    share = ghosts.right_rows(np.arange(len(truth)), brightest, truth)
    yield Number(f'{name}: right rows, plain argmax', share, '')


def edge_bias():
    """Distances of points at an edge from the part, with and without items 4 and 6."""
    for kind in ('step', 'border'):
        sweep = edges.sweep(kind)
        careful = _learnt(sweep)
        plain = replace(careful, shape_uncertainty=False)
        for name, settings, half in (
            ('plain', plain, 0),
            ('default sigma limit', careful, 0),
            ('space-time', plain, 8),
            ('space-time, default sigma limit', careful, 8),
        ):
            distances = sweep.errors(_profiles(sweep, settings, half))
            note = f'worst {distances.max() * 1e3:.3f} mm, {len(distances)} points'
            yield Number(f'{kind}, {name}: rms', rms(distances) * 1e3, 'mm', note=note)


def _learnt(sweep):
    """Return the settings that a scan of the whole block would have."""
    acquisition = Acquisition(sweep.cell, AcquisitionSettings())
    acquisition.resolve_auto_settings(sweep.around)
    return acquisition.settings.extract


def _profiles(sweep, settings, half):
    frames = sweep.frames
    found = [extract(frame.image, settings=settings) for frame in frames]
    if not half:
        return [triangulate(sweep.cell, *pair) for pair in zip(frames, found, strict=True)]
    return [
        space_time_profile(sweep.cell, frames[k - half : k + half + 1], half, found[k], settings)
        for k in range(half, len(frames) - half)
    ]


def real():
    """The measured scan: the bare platter, and a sheet of the object to look at."""
    data = measured_scan()
    if data is None:
        yield Number('platter of the measured scan', float('nan'), 'mm', note='no data: skipped')
        return
    cell = measured.calibrated(data)
    pictures = measured.frames(data / 'empty_table')
    mass = measured.platter_heights(cell, pictures, measured.MASS)
    ours = measured.platter_heights(cell, pictures, ExtractSettings())
    both = mass.keys() & ours.keys()
    for rows, of_ours, of_mass in (
        ('all rows', ours.values(), mass.values()),
        ('rows of both', [ours[row] for row in both], [mass[row] for row in both]),
    ):
        error, theirs = (1e3 * rms(list(heights)) for heights in (of_ours, of_mass))
        note = f'{len(of_ours)} points; center of mass {theirs:.3f} mm, {len(of_mass)} points'
        yield Number(f'platter rms of the default, {rows}', error, 'mm', at_most(theirs), note)
    fitted = measured.platter_heights(cell, pictures, ExtractSettings(method='gaussian'))
    note = f'{len(fitted)} points; the platter glows'
    yield Number('platter rms of gaussian', 1e3 * rms(list(fitted.values())), 'mm', note=note)
    chosen = measured.frames(data / 'object')[::27][:12]
    count = measured.draw_sheet(cell, chosen, ExtractSettings())
    yield Number('stripe points in 12 pictures of the object', count, '', note=str(measured.SHEET))
