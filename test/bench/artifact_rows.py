# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Acceptance test of the bench cell: a rendered ball bar, by the cell of our own calibration."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from support.artifact_scan import CENTERS
from support.artifact_scan import LENGTH
from support.artifact_scan import RADIUS
from support.rendered_stripes import Job
from support.rendered_stripes import render
from support.rendered_stripes import stripes_of

from bench import at_most
from bench import Number
from bench.joint_rows import Calibrated
from bench.pool import mapped
from ivfmc_ros.acceptance.artifact import parse_artifact
from ivfmc_ros.acceptance.certificate import write_certificate
from ivfmc_ros.acceptance.check import Check
from ivfmc_ros.acceptance.check import check_artifact
from ivfmc_ros.acceptance.check import Limits
from ivfmc_ros.acceptance.points import measured_points
from ivfmc_ros.acceptance.record import check_document
from ivfmc_ros.cell.calibration_id import calibration_id
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.model import Profile
from ivfmc_ros.pipeline import reconstruct_profiles
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.loading import Solid
from ivfmc_ros.simulation.parts.solids import sphere
from ivfmc_ros.stripe.stripe import Stripe
from ivfmc_ros.stripe.triangulate import sensitivity

ARTIFACT = f'ball_bar:{2e3 * RADIUS:g}mm:{1e3 * LENGTH:g}mm'
CERTIFICATE = Path('build/bench/certificate')
# Profiles of each laser over a turn: 0.65 mm apart on a sphere, whose chords are 0.005 mm off it.
_STEPS = 480
_PARTS = 8  # jobs of each laser, so that all cores have work
_FORM, _SIZE, _DISTANCE = 0.06, 0.03, 0.03  # mm, the bars


def artifact_rows(found: Calibrated) -> Iterator[Number]:
    """Yield the errors of the rendered ball bar and what the certificate states of them."""
    mapped(render, ball_bar_jobs())
    check = ball_bar_check(found.joint)
    write_page(check, found.joint)
    bars = {'PF': _FORM, 'PD': _FORM, 'PS': _SIZE, 'SD': _DISTANCE}
    for one in check.characteristics:
        bar = bars[one.symbol.split()[0]]
        stated = 'none' if one.u_cell is None else f'{2e3 * one.u_cell:.4f} mm'
        ratio = '' if one.normalized_error is None else f', |E|/U {one.normalized_error:.2f}'
        note = f'{one.verdict}; certificate states U {stated}{ratio}'
        yield Number(f'rendered ball bar: {one.name}', 1e3 * one.value, 'mm', None, note)
        yield Number(f'rendered ball bar: |{one.name}|', 1e3 * abs(one.value), 'mm', at_most(bar))


def ball_bar_jobs() -> list[Job]:
    """Return what is to be rendered: parts of a turn of both lasers."""
    cell, solid = bench_cell(), ball_bar()
    angles = 2 * np.pi * np.arange(_STEPS) / _STEPS
    return [
        Job(cell, solid, laser, part, seed=7000 + 100 * laser + number)
        for laser in range(len(cell.lasers))
        for number, part in enumerate(np.split(angles, _PARTS))
    ]


def ball_bar() -> Solid:
    """Return the two spheres of the bar, without what holds them."""
    one = sphere(RADIUS, 0.0)
    vertices = np.concatenate([one.vertices_xyz + center for center in CENTERS])
    faces = np.concatenate([one.faces, one.faces + len(one.vertices_xyz)])
    return Solid(vertices_xyz=vertices, faces=faces)


def ball_bar_check(cell: Cell) -> Check:
    """Rebuild the rendered ball bar with a cell, and measure it."""
    profiles, seq = [], 0
    for job in ball_bar_jobs():
        for stripe, angle in zip(stripes_of(job), job.angles, strict=True):
            profiles.append(_profile(cell, job.laser, stripe, float(angle), seq))
            seq += 1
    made = reconstruct_profiles(cell, profiles)
    artifact = parse_artifact(ARTIFACT, u=0.5e-6)
    points = measured_points(made.mesh, Limits().max_u(artifact))
    return check_artifact(artifact, points, cell=cell)


def _profile(cell: Cell, laser: int, stripe: Stripe, angle: float, seq: int) -> Profile:
    plane, rays = cell.lasers[laser], cell.camera.rays(stripe.uv)
    slopes = sensitivity(cell, plane, rays)
    return Profile(
        points_xyz=cell.turntable.to_part(plane.intersect(rays), angle),
        uv=stripe.uv,
        intensity=stripe.intensity,
        sigma=stripe.sigma * np.linalg.norm(slopes, axis=1),
        angle=angle,
        laser=laser,
        view=laser,
        seq=seq,
        stamp_ns=seq,
    )


def write_page(check: Check, cell: Cell) -> None:
    """Write the certificate, to be looked at."""
    identity = calibration_id(cell.turntable, cell.lasers)
    document = check_document(check, identity, 'rendered ball bar')
    CERTIFICATE.mkdir(parents=True, exist_ok=True)
    write_certificate(CERTIFICATE, replace(check), document)
