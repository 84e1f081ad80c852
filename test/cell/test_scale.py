# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from ivfmc_ros.cell.covariance import CellCovariance
from ivfmc_ros.cell.covariance import parameter_names
from ivfmc_ros.cell.scale import doubt_text
from ivfmc_ros.cell.scale import scale_doubt
from ivfmc_ros.cell.scale import scale_u
from ivfmc_ros.inspection.settings import InspectSettings
from ivfmc_ros.simulation.bench import bench_cell

DOUBTED = {'board': {'scale_doubt': -0.003}}


def covariance(stated):
    cell = bench_cell()
    names = parameter_names(cell.camera, [laser.name for laser in cell.lasers])
    return CellCovariance(parameters=names, matrix=np.eye(len(names)), scale_u=stated)


def test_doubt_of_the_scale_is_part_of_its_uncertainty():
    assert scale_u({}, None) is None
    assert scale_u({}, covariance(2e-4)) == 2e-4
    assert scale_u(DOUBTED, None) == pytest.approx(0.003 / np.sqrt(3))
    assert scale_u(DOUBTED, covariance(1e-3)) == pytest.approx(np.hypot(1e-3, 0.003 / np.sqrt(3)))
    assert scale_u(DOUBTED, covariance(None)) == pytest.approx(0.003 / np.sqrt(3))


def test_doubt_is_said_with_its_consequence():
    assert doubt_text({}) == ''
    assert doubt_text(DOUBTED).endswith('0.30 mm in 100 mm too small')


@pytest.mark.parametrize(
    'board', ['a gauge', None, {}, {'scale_doubt': 'x'}, {'scale_doubt': True}]
)
def test_note_without_a_doubt_is_none(board):
    assert scale_doubt({'board': board}) == 0.0


def test_inspection_counts_the_doubt_unless_the_user_states_the_scale():
    cell = replace(bench_cell(), notes=DOUBTED)
    settings = InspectSettings()
    found = settings.with_scale_of(cell)
    assert found.conditions.scale_u == pytest.approx(0.003 / np.sqrt(3))
    stated = replace(settings, conditions=replace(settings.conditions, scale_u=1e-4))
    assert stated.with_scale_of(cell).conditions.scale_u == 1e-4
