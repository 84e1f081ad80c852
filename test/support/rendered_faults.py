# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Slips, camera stalls and clock jumps of rendered scans: the code, and whether the shape is wrong.

The thresholds of the check for lost steps were developed on the demo part, a box, a plate and a
cylinder; none of these is here.
"""

import asyncio
from dataclasses import replace
from functools import cache
import math
from typing import NamedTuple

import numpy as np
import trimesh

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.scan.job import run_job
from ivfmc_ros.scan.plan import make_plan
from ivfmc_ros.scan.plan import MotionLimits
from ivfmc_ros.scan.request import ScanRequest
from ivfmc_ros.scan.state_machine import StateMachine
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.loading import Solid
from ivfmc_ros.simulation.parts.prism import circle
from ivfmc_ros.simulation.parts.prism import Layer
from ivfmc_ros.simulation.parts.prism import polyline
from ivfmc_ros.simulation.parts.prism import stack
from ivfmc_ros.simulation.parts.solids import stepped_shaft
from ivfmc_ros.stripe.stripe import Stripe
from support.erring_table import NOISE
from support.erring_table import noisy
from support.erring_table import Sweep
from support.real_scan import data_folder
from support.rendered_cell import Fault
from support.rendered_cell import LASERS
from support.rendered_cell import RenderedCell
from support.rendered_stripes import Job
from support.rendered_stripes import jobs_of
from support.rendered_stripes import stripes_of
from support.shape_error import share_off

# Profiles of a turn, and of a second: 27 degrees a second.
STEPS, RATE = 200, 15.0
KINDS = ('slip', 'camera stall', 'clock jump')
# Ranges from which the sizes are drawn, on a logarithmic scale: degrees, seconds, seconds.
SIZES = {'slip': (0.5, 20.0), 'camera stall': (0.3, 5.0), 'clock jump': (0.01, 3600.0)}
# A shape is wrong if more points than this share lie beyond their expanded uncertainty, above the
# share of a scan without a fault: 1 % of the points are a face of about 1 cm2.
_WRONG_SHARE = 0.01
_STRIDE = 5  # of the points that are compared
# Parts of CAD data, in inches.
_CAD, _INCH = {'angle block': 'angle_block.STL', 'idler riser': 'idler_riser.STL'}, 0.0254


class Case(NamedTuple):
    """One scan: a part, the number of lasers, the kind of fault, and the seed of the rest."""

    part: str
    lasers: int
    kind: str
    seed: int


def case_of(lasers: int, kind: str, seed: int) -> Case:
    """Return the scan of a seed; the seeds go through the parts."""
    names = parts()
    return Case(names[seed % len(names)], lasers, kind, seed)


class Found(NamedTuple):
    """
    What became of a scan with a fault.

    case : the scan
    size : degrees or seconds, with sign
    at : share of the beam's time before it
    said : code and detail, '' for plain OK
    wrong : points are off by more than their stated uncertainty; None where there is no result
    size_error : of the slip that was found, degrees; None if none was
    """

    case: Case
    size: float
    at: float
    code: str
    said: str
    wrong: bool | None
    size_error: float | None = None

    @property
    def silent(self) -> bool:
        """Whether the scan is OK without a word although its shape is wrong."""
        return bool(self.wrong) and not self.said


def parts() -> list[str]:
    """Return the names of the parts that show a rotation; those of CAD data where it is."""
    folder = data_folder() / 'parts'
    return ['bracket', *(name for name, file in _CAD.items() if (folder / file).is_file())]


ROUND = 'stepped shaft'


@cache
def part_called(name: str) -> Solid:
    if name == 'bracket':
        return _bracket()
    if name == ROUND:
        return stepped_shaft([(0.034, 0.018), (0.022, 0.024), (0.013, 0.02)])
    mesh = trimesh.load(data_folder() / 'parts' / _CAD[name])
    # corners of one vertex may differ by rounding
    mesh.merge_vertices(digits_vertex=5)
    low, high = mesh.bounds
    middle = np.array([*(low + high)[:2] / 2, low[2]])
    vertices = (np.asarray(mesh.vertices) - middle) * _INCH
    return Solid(vertices_xyz=vertices, faces=np.asarray(mesh.faces, dtype=np.int64))


def _bracket() -> Solid:
    """Return an L-shaped bracket with a hole in its foot and an upright leg, off the axis."""
    foot = polyline((-0.03, -0.02), (0.028, -0.02), (0.028, 0.022), (-0.03, 0.022), (-0.03, -0.02))
    leg = polyline((-0.03, -0.02), (-0.02, -0.02), (-0.02, 0.022), (-0.03, 0.022), (-0.03, -0.02))
    hole = circle(0.006, (0.01, 0.003))[::-1]
    return stack(
        [
            Layer(low=0.0, high=0.012, bottom=[foot, hole]),
            Layer(low=0.012, high=0.055, bottom=[leg]),
        ]
    )


def jobs(name: str) -> list[Job]:
    """Return what is rendered of a part: a turn of each laser."""
    angles = 2.0 * np.pi * np.arange(STEPS) / STEPS
    sweeps = [Sweep(laser=laser, commanded=angles, true=angles) for laser in (0, 1)]
    return jobs_of(bench_cell(), part_called(name), sweeps, 23)


@cache
def _turn(name: str) -> list[list[Stripe]]:
    return [stripes_of(job) for job in jobs(name)]


def _measured(name: str, seed: int) -> list[list[Stripe]]:
    """Return the stripes of a seed: the extracted ones with further noise, which sigma states."""
    rng = np.random.default_rng((24, seed))
    return [
        [replace(noisy(stripe, rng), sigma=np.hypot(stripe.sigma, NOISE)) for stripe in stripes]
        for stripes in _turn(name)
    ]


def drawn(case: Case) -> tuple[Fault, float, float]:
    """Return the fault of a seed, its size (degrees or seconds), and its time as a share."""
    rng = np.random.default_rng((25, KINDS.index(case.kind), case.lasers, case.seed))
    share = float(rng.uniform(0.05, 0.95))
    at = share * case.lasers * STEPS / RATE
    sign = 1.0 if case.kind == 'camera stall' else float(rng.choice((-1.0, 1.0)))
    size = sign * float(np.exp(rng.uniform(*np.log(SIZES[case.kind]))))
    clock = str(rng.choice(('camera', 'table', 'all')))
    fault = {
        'slip': Fault(at=at, slip=math.radians(size)),
        'camera stall': Fault(at=at, stall=abs(size)),
        'clock jump': Fault(at=at, jump=size, clock=clock),
    }[case.kind]
    return fault, size, share


def scanned(case: Case) -> Found:
    """Scan the part with the fault of a seed."""
    fault, size, share = drawn(case)
    code, detail, scan = _scan(case, fault)
    made = scan.registered
    wrong, size_error = None, None
    if made is not None:
        lag = fault.slip
        more = _share_off(case.part, made.views, made.poses, lag)
        wrong = more - _share_off_without(case.part, case.lasers) > _WRONG_SHARE
        if code == 'SLIPPED' and case.kind == 'slip' and math.isfinite(made.table.size):
            size_error = abs(math.degrees(made.table.size) - size)
    said = '' if code == 'OK' and not detail else f'{code}: {detail}'
    return Found(case, size, share, code, said, wrong, size_error)


def good(case: Case) -> str:
    """Return the code of a scan without a fault, with its detail where it has one."""
    code, detail, _ = _scan(case, Fault())
    return code if not detail else f'{code}: {detail}'


def _scan(case: Case, fault: Fault) -> tuple[str, str, RenderedCell]:
    request = ScanRequest(profiles=STEPS, lasers=LASERS[: case.lasers])
    motion = MotionLimits(profile_rate=RATE)
    # where a sweep begins and ends is where one laser sees the part twice
    position = np.random.default_rng((27, case.seed)).uniform(0.0, 2.0 * np.pi)
    plan = make_plan(request, LASERS, motion, position)
    tools = RenderedCell(
        bench_cell(), _measured(case.part, case.seed), plan, motion, fault, case.seed
    )
    outcome = asyncio.run(run_job(StateMachine(), plan, motion, tools))  # type: ignore[arg-type]
    # a scan that breaks shows nothing of the fault
    assert outcome.code != 'INTERNAL', outcome.detail
    return outcome.code, outcome.detail, tools


@cache
def _share_off_without(name: str, lasers: int) -> float:
    _, _, scan = _scan(Case(name, lasers, KINDS[0], 0), Fault())
    made = scan.registered
    return _share_off(name, made.views, made.poses, 0.0) if made is not None else 0.0


def _share_off(name: str, views: list[View], poses: Poses, lag: float) -> float:
    points, sigma = _cloud(views, poses)
    # the part of the scan before the slip may be right, or the one after it, or each by half
    return share_off(points, sigma, part_called(name), (0.0, 0.5 * lag, lag) if lag else (0.0,))


def _cloud(views: list[View], poses: Poses) -> tuple[Floats, Floats]:
    points = [
        transforms.apply(T, view.points_xyz[view.valid])
        for T, view in zip(poses.turntable_from_view, views, strict=True)
    ]
    sigma = [view.sigma[view.valid] for view in views]
    return np.concatenate(points)[::_STRIDE], np.concatenate(sigma)[::_STRIDE]
