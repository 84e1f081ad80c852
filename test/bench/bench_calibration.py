# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Calibration on rendered pictures with known truth and on measured ones, and the acceptance test.

Pictures are rendered once and kept under build/, so that the first run takes longer.
"""

from collections.abc import Iterator

import numpy as np
from support.calibration_pictures import CHESSBOARD
from support.real_scan import measured_scan

from bench import at_most
from bench import Number
from bench.artifact_rows import artifact_rows
from bench.joint_rows import Calibrated
from bench.joint_rows import calibrated
from bench.joint_rows import real_rows
from bench.joint_rows import rendered_rows
from bench.joint_rows import SEEDS
from bench.knocks import knocked
from bench.pool import mapped
from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.bench import LASER_AZIMUTHS


def run() -> Iterator[Number]:
    found = mapped(calibrated, SEEDS)
    yield from single_rows(found[0])
    yield from rendered_rows(found)
    yield from artifact_rows(found[0])
    yield from knocked()
    data = measured_scan()
    if data is not None:
        yield from real_rows(data)


def single_rows(found: Calibrated) -> Iterator[Number]:
    """Errors of planes and axis by both ways, of the first seed."""
    truth = bench_cell()
    for way, cell in (('separate steps', found.steps), ('joint', found.joint)):
        for number in range(len(truth.lasers)):
            yield plane_error(truth, number, cell.lasers[number], way)
        yield axis_error(truth, cell, way)
    note = f'{CHESSBOARD}; separate steps {found.steps_rms["board_px"]:.4f} px'
    yield Number('joint: corners of the board, rms', found.joint_rms['board_px'], 'px', None, note)


def plane_error(truth: Cell, number: int, found: LaserPlane, way: str) -> Number:
    """Return the greatest distance of points of a true laser plane from the one found."""
    azimuth = list(LASER_AZIMUTHS.values())[number]
    r, z = np.meshgrid(np.linspace(-0.06, 0.06, 13), np.linspace(0.0, 0.1, 11))
    base = np.stack([r * np.cos(azimuth), r * np.sin(azimuth), z], axis=-1).reshape(-1, 3)
    points = transforms.apply(truth.turntable.camera_from_base, base)
    off = np.abs(found.distance(points))
    design = np.column_stack([points, np.ones(len(points))])
    claimed = np.sqrt(np.einsum('ni,ij,nj->n', design, found.covariance, design))
    note = f'{np.sqrt(np.mean((off / claimed) ** 2)):.1f} claimed sigmas (camera known)'
    name = f'{way}: laser plane {found.name}, worst in the volume'
    return Number(name, float(off.max()) * 1e3, 'mm', at_most(0.03), note)


def axis_error(truth: Cell, cell: Cell, way: str) -> Number:
    """Return the greatest distance between the true axis and the one found."""
    found, true = cell.turntable.camera_from_base, truth.turntable.camera_from_base
    heights = np.linspace(0.0, 0.1, 11)[:, None]
    apart = (found[:3, 3] + heights * found[:3, 2]) - (true[:3, 3] + heights * true[:3, 2])
    up = true[:3, 2]
    across = apart - np.outer(apart @ up, up)
    worst = float(np.linalg.norm(across, axis=1).max())
    return Number(f'{way}: table axis, worst in the volume', worst * 1e3, 'mm', at_most(0.05))
