# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rendered scans with a slip of the table, and what the registration says about each."""

from functools import cache
import math
from typing import NamedTuple

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.registration.align import align
from ivfmc_ros.registration.slip import check_registration
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.loading import Solid
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.simulation.parts.solids import cylinder
from ivfmc_ros.simulation.parts.solids import demo_part
from ivfmc_ros.simulation.parts.solids import plate
from ivfmc_ros.surface import Surface
from support.erring_table import Sweep
from support.registration_scans import cloud
from support.rendered_stripes import Job
from support.rendered_stripes import jobs_of
from support.rendered_stripes import stripes_of
from support.slipping_scan import SlippingScan

# The thresholds of the check were developed on some of these parts (demo part, plate, cylinder):
# the figures are not independent of them.
PARTS, ROUND = ('demo part', 'box off the axis'), ('cylinder', 'plate')
# Profiles of a turn, and of one laser beyond the turn.
STEPS, CLOSURE = 200, 17
# Smallest and largest slip, degrees.
_SIZES = (0.5, 20.0)
# Points farther than this from the true surface are wrong, meters: five times what extraction and
# triangulation leave of this cell. So many more than without the slip make a wrong shape.
_WRONG, _WRONG_SHARE = 2.5e-4, 0.005
_STRIDE = 11  # of the points that are compared


class Case(NamedTuple):
    """
    A scan with a slip.

    degrees, after : size, and number of profiles before it
    wrong : the shape is off by more than the uncertainty of the scan
    size_error : degrees; None if no size was found
    """

    degrees: float
    after: int
    code: str
    wrong: bool
    size_error: float | None


def part_called(name: str) -> Solid:
    made = {
        'demo part': demo_part,
        'box off the axis': lambda: box((0.044, 0.030, 0.060)).moved(
            transforms.rigid(transforms.rotation_z(0.3), (0.006, -0.004, 0.0))
        ),
        'cylinder': lambda: cylinder(0.025, 0.06),
        'plate': lambda: plate(0.07, 0.06, 0.006),
    }
    return made[name]()


def jobs(name: str) -> list[Job]:
    angles = 2.0 * np.pi * np.arange(STEPS) / STEPS
    sweeps = [Sweep(laser=laser, commanded=angles, true=angles) for laser in (0, 1)]
    return jobs_of(bench_cell(), part_called(name), sweeps, 17)


def all_jobs() -> list[Job]:
    return [job for name in (*PARTS, *ROUND) for job in jobs(name)]


@cache
def _scan(name: str, lasers: int) -> SlippingScan:
    return SlippingScan(
        cell=bench_cell(),
        stripes=[stripes_of(job) for job in jobs(name)],
        lasers=tuple(range(lasers)),
        closure=CLOSURE if lasers == 1 else 0,
    )


@cache
def _share_wrong_without_slip(name: str, lasers: int) -> float:
    return _share_wrong(name, _scan(name, lasers))


def _share_wrong(name: str, scan: SlippingScan) -> float:
    """Return the share of points that are off; the slip's part before or after it may be right."""
    part = part_called(name)
    surface = Surface(part.vertices_xyz, part.faces)
    views = scan.views()
    shares = []
    # as the shape is what counts, it may be turned as a whole
    for turn in (0.0, scan.size):
        points = cloud(views)[::_STRIDE] @ transforms.rotation_z(turn).T
        shares.append(float(np.mean(np.abs(surface.signed_distance(points)) > _WRONG)))
    return min(shares)


def good(case: tuple[str, int, int]) -> str:
    """Return the code of a scan without a slip; the seed adds noise."""
    name, lasers, seed = case
    return _code(_with(_scan(name, lasers), 0.0, 0, seed))[0]


def slipped(case: tuple[str, int, int]) -> Case:
    """Return what the check says about a scan with the slip of a seed."""
    name, lasers, seed = case
    rng = np.random.default_rng((11, seed))
    degrees = float(rng.choice((-1.0, 1.0)) * np.exp(rng.uniform(*np.log(_SIZES))))
    scan = _scan(name, lasers)
    total = len(scan.lasers) * (scan.steps + scan.closure)
    after = int(rng.uniform(0.05, 0.95) * total)
    scan = _with(scan, math.radians(degrees), after, seed)
    code, size = _code(scan)
    more = _share_wrong(name, scan) - _share_wrong_without_slip(name, lasers)
    return Case(
        degrees=degrees,
        after=after,
        code=code,
        wrong=more > _WRONG_SHARE,
        size_error=abs(math.degrees(size) - degrees)
        if code == 'SLIPPED' and math.isfinite(size)
        else None,
    )


def _with(scan: SlippingScan, size: float, after: int, seed: int) -> SlippingScan:
    return SlippingScan(
        cell=scan.cell,
        stripes=scan.stripes,
        size=size,
        after=after,
        lasers=scan.lasers,
        closure=scan.closure,
        seed=seed,
    )


def _code(scan: SlippingScan) -> tuple[str, float]:
    views = scan.views()
    poses, verdicts = align(views, 'joint')
    found = check_registration(views, poses, verdicts)
    return found.code, found.size
