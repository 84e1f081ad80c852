# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.calibration.nominal import axial_cell
from ivfmc_ros.calibration.nominal import AxialLaser
from ivfmc_ros.calibration.nominal import paper_cell
from ivfmc_ros.calibration.nominal import PaperGeometry
from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import CellError
from ivfmc_ros.simulation.bench import AIM_HEIGHT
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.bench import CAMERA_DISTANCE
from ivfmc_ros.simulation.bench import CAMERA_ELEVATION
from ivfmc_ros.simulation.bench import LASER_AZIMUTHS


def test_bench_cell_is_given_by_its_lengths():
    bench = bench_cell()
    lasers = [AxialLaser(name=name, azimuth=azimuth) for name, azimuth in LASER_AZIMUTHS.items()]
    cell = axial_cell(bench.camera, CAMERA_DISTANCE, CAMERA_ELEVATION, AIM_HEIGHT, lasers)
    np.testing.assert_allclose(
        cell.turntable.camera_from_base, bench.turntable.camera_from_base, atol=1e-12
    )
    for found, true in zip(cell.lasers, bench.lasers, strict=True):
        np.testing.assert_allclose(found.normal, true.normal, atol=1e-12)
        assert found.offset == pytest.approx(true.offset)


def test_paper_arrangement_sees_its_stripe_on_the_axis():
    geometry = PaperGeometry(distance=0.4, height=0.2, tilt=np.radians(25), laser_height=0.03)
    cell = paper_cell(bench_cell().camera, geometry)
    assert cell.lasers[0].stripe == 'columns'
    on_axis = transforms.apply(cell.turntable.camera_from_base, np.array([[0.0, 0.0, 0.03]]))
    np.testing.assert_allclose(cell.lasers[0].distance(on_axis), 0.0, atol=1e-12)
    # at D = 0.4 m and H = 0.2 m the point is atan(0.2 / 0.4) = 26.6 degrees down
    v = cell.camera.project(on_axis)[0, 1]
    expected = cell.camera.K[1, 2] + cell.camera.K[1, 1] * np.tan(np.radians(26.565 - 25))
    assert v == pytest.approx(expected, abs=1.0)


def test_camera_in_the_sheet_is_refused():
    geometry = PaperGeometry(distance=0.4, height=0.0, tilt=0.0, laser_height=0.05)
    with pytest.raises(CellError, match='camera center lies in the laser plane'):
        paper_cell(bench_cell().camera, geometry)
