# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The scans of the registration's bench, and the result of each for one seed."""

from dataclasses import replace
from functools import cache
import time
from typing import NamedTuple

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import View
from ivfmc_ros.registration.align import align
from ivfmc_ros.registration.incremental import IncrementalRegistration
from ivfmc_ros.registration.merge.merge import merge
from ivfmc_ros.registration.self_calibration.calibration_prior import prior_covariance
from ivfmc_ros.registration.self_calibration.jacobians import corrected_view
from ivfmc_ros.registration.self_calibration.jacobians import measured_view
from ivfmc_ros.registration.self_calibration.parameters import CellParameters
from ivfmc_ros.registration.self_calibration.refine import refine
from ivfmc_ros.registration.self_calibration.refine import RefinementResult
from ivfmc_ros.registration.solver.gauss_newton import pose_vector
from ivfmc_ros.registration.solver.prior import CellPrior
from ivfmc_ros.registration.solver.prior import TablePrior
from ivfmc_ros.simulation.bench import axial_plane
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.loading import Solid
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.simulation.parts.solids import cylinder
from ivfmc_ros.simulation.parts.solids import demo_part
from ivfmc_ros.simulation.parts.solids import plate
from ivfmc_ros.simulation.parts.solids import sphere
from support.clampings import clamped
from support.clampings import displacement
from support.clampings import lying
from support.registration_scans import Errors
from support.registration_scans import Recording
from support.registration_scans import share_left
from support.registration_sweeps import SlippingSweeps
from support.rendered_stripes import Job
from support.rendered_stripes import jobs_of
from support.rendered_stripes import rendered_stripes

ORDERS = (1, 2, 5)
GROUPS = ('axis', 'angle', 'lasers')
# of each: pictures a turn
STEPS, BLIND_STEPS, PLAIN_STEPS, SWEEP_STEPS, CLAMPED_STEPS = 400, 200, 100, 240, 120
REFINED = ('box off the axis', 'flange')
# of each: components of a pose that its surface does not constrain
PLAIN = {'cylinder': (2, 5), 'sphere': (0, 1, 2), 'plate': (4, 5)}


def part_called(name: str) -> Solid:
    if name == 'box off the axis':
        place = transforms.rigid(transforms.rotation_z(0.3), (0.006, -0.004, 0.0))
        return box((0.044, 0.030, 0.060)).moved(place)
    made = {
        'flange': demo_part,
        'cylinder': lambda: cylinder(0.025, 0.06),
        'sphere': lambda: sphere(0.025),
        'plate': lambda: plate(0.07, 0.06, 0.006),
    }
    return made[name]()


@cache
def recording(name: str) -> Recording:
    return Recording(bench_cell(), part_called(name), PLAIN_STEPS if name in PLAIN else STEPS)


@cache
def blind() -> Recording:
    """Lasers at +-30 degrees, which see no error of order 6."""
    cell = bench_cell()
    base = cell.turntable.camera_from_base
    lasers = tuple(
        axial_plane(name, np.radians(azimuth), base)
        for name, azimuth in (('left', 30.0), ('right', -30.0))
    )
    return Recording(replace(cell, lasers=lasers), part_called(REFINED[0]), BLIND_STEPS)


@cache
def sweeps(name: str) -> SlippingSweeps:
    return SlippingSweeps(bench_cell(), part_called(name), SWEEP_STEPS)


def all_jobs(seeds: int) -> list[Job]:
    """Return all render jobs of the bench."""
    jobs = [job for name in (*REFINED, *PLAIN) for job in recording(name).jobs]
    jobs += blind().jobs
    jobs += [job for name in REFINED for job in sweeps(name).jobs]
    part = demo_part()
    places = [(np.eye(4), 1), *((lying(part, seed), 100 + seed) for seed in range(seeds))]
    for place, seed in places:
        turns = Recording(bench_cell(), part, CLAMPED_STEPS).sweeps
        jobs += jobs_of(bench_cell(), part.moved(place), turns, seed)
    return jobs


class Pull(NamedTuple):
    """A parameter reported as observed, and its error over its claimed sigma."""

    name: str
    size: float


class Corrected(NamedTuple):
    """
    Result of a refinement.

    left : share of the error that is left
    exact : the same if the observable directions had no noise
    pulls : of the observed parameters
    """

    left: float
    exact: float
    pulls: list[Pull]


def refined(case: tuple[str, int]) -> Corrected:
    name, seed = case
    scan, errors = recording(name), Errors(seed=seed, order=ORDERS[seed % len(ORDERS)])
    believed, views = scan.erring(errors)
    found = refine(believed, views, GROUPS)
    uncorrected = scan.rms(views)
    truth = scan.truth(believed, errors, found.height)
    exact = scan.rms(_without_noise(believed, views, found, truth))
    pulls = [
        Pull(one.name, float(abs(one.value - truth.get(one.name, 0.0)) / one.sigma))
        for one in found.estimates
        if one.observed
    ]
    return Corrected(
        left=share_left(uncorrected, scan.rms(found.views, found.poses), scan.perfect),
        exact=share_left(uncorrected, exact, scan.perfect),
        pulls=pulls,
    )


def _without_noise(
    believed: Cell, views: list[View], found: RefinementResult, truth: dict[str, float]
) -> list[View]:
    """Return the views for the cell that data without noise would give with the prior."""
    parameters = CellParameters(
        cell=believed, groups=frozenset(GROUPS), height=found.height, prior=CellPrior()
    )
    prior = prior_covariance(parameters)
    true = np.array([truth.get(name, 0.0) for name in parameters.names])
    values = (prior - found.covariance) @ np.linalg.solve(prior, true)
    return [corrected_view(measured_view(believed, view), parameters, values) for view in views]


def known_angle(seed: int) -> float:
    """Return the share of the error that is left on the flange if the table does not err."""
    scan, errors = recording('flange'), Errors(seed=seed, order=1, table_errs=False)
    believed, views = scan.erring(errors)
    found = refine(believed, views, ('axis', 'lasers'))
    return share_left(scan.rms(views), scan.rms(found.views, found.poses), scan.perfect)


def blind_order(seed: int) -> tuple[int, float]:
    """Return how many coefficients of order 6 are claimed, and how far they moved (sigmas)."""
    believed, views = blind().erring(Errors(seed=seed, order=6, cell_errs=False))
    found = refine(believed, views, GROUPS)
    sixth = [one for one in found.estimates if one.name in ('angle cos 6', 'angle sin 6')]
    moved = max(abs(one.value) / one.prior_sigma for one in sixth)
    return sum(one.observed for one in sixth), moved


def plain(case: tuple[str, int]) -> tuple[float, float]:
    """Return how far free directions moved (sigmas), and the rms over that of the table."""
    name, seed = case
    scan, prior = recording(name), TablePrior()
    _, views = scan.erring(Errors(seed=seed, order=ORDERS[seed % len(ORDERS)]))
    poses, _ = align(views, 'joint', prior=prior)
    values = pose_vector(poses.turntable_from_view[1]) / prior.sigma
    moved = float(np.abs(values[list(PLAIN[name])]).max())
    return moved, scan.rms(views, poses) / scan.rms(views)


def slipped(case: tuple[str, int]) -> float:
    """Return the share of the error that is left."""
    name, seed = case
    views, perfect = sweeps(name).seed(seed)
    poses, _ = align(views, 'joint')
    rms = recording(name).rms
    return share_left(rms(views), rms(views, poses), rms(perfect))


def clamping(seed: int) -> tuple[float | None, float]:
    """Return the displacement of the merged part (meters; None if refused), and seconds."""
    cell, part = bench_cell(), demo_part()
    place = lying(part, seed)
    taken = [
        clamped(name, cell, part, T, CLAMPED_STEPS, number, rendered_stripes)
        for name, T, number in (('upright', np.eye(4), 1), ('lying', place, 100 + seed))
    ]
    begin = time.perf_counter()
    try:
        found = merge(taken).first_from_clamping[1]
    except GeometryError:
        return None, time.perf_counter() - begin
    seconds = time.perf_counter() - begin
    return displacement(part, found @ place, np.eye(4)), seconds


def placings() -> list[float]:
    """Return the seconds in which each sweep but the first of two scans is registered."""
    seconds = []
    for name in REFINED:
        views, _ = sweeps(name).seed(0)
        registration = IncrementalRegistration()
        for view in views:
            begin = time.perf_counter()
            registration.add(view)
            if view.number:
                seconds.append(time.perf_counter() - begin)
    return seconds
