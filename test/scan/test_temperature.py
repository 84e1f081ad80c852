# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import math

import pytest

from ivfmc_ros.errors import FileError
from ivfmc_ros.inspection.conditions import Conditions
from ivfmc_ros.scan.temperature import drift_text
from ivfmc_ros.scan.temperature import load_temperature
from ivfmc_ros.scan.temperature import save_temperature
from ivfmc_ros.scan.temperature import TEMPERATURE_FILE
from ivfmc_ros.scan.temperature import TemperatureLog


def measured(*readings, variance=0.0):
    log = TemperatureLog(0.5)
    for celsius in readings:
        log.add(celsius, variance)
    return log.summary()


def test_mean_and_uncertainty_of_a_temperature_that_rises():
    found = measured(22.0, 23.0, 24.0, variance=0.04)
    assert (found.mean_c, found.low_c, found.high_c, found.readings) == (23.0, 22.0, 24.0, 3)
    assert found.u_k == pytest.approx(math.hypot(0.2, 2.0 / math.sqrt(12.0)))


def test_sensor_that_states_no_variance_has_the_uncertainty_of_the_parameter():
    assert measured(21.0).u_k == 0.5
    assert measured(21.0, variance=math.nan).u_k == 0.5


def test_readings_that_are_no_numbers_are_left_out():
    assert measured(math.nan, math.inf) is None
    assert measured(math.nan, 20.0).readings == 1


@pytest.mark.parametrize(
    ('calibrated', 'said'), [(20.0, True), (23.0, False), (None, False), ('warm', False)]
)
def test_cell_that_is_warmer_than_when_it_was_calibrated(calibrated, said):
    text = drift_text(measured(27.0), calibrated, 5.0)
    assert bool(text) == said
    if said:
        assert 'calibrated at 20 C and has 27.0 C now' in text


def test_file_gives_the_conditions_of_the_inspection(tmp_path):
    assert load_temperature(tmp_path) is None
    save_temperature(tmp_path, measured(24.0, variance=0.01))
    found = load_temperature(tmp_path).applied_to(Conditions(expansion=2e-5), tmp_path)
    assert (found.temperature, found.expansion) == (24.0, 2e-5)
    assert found.temperature_u == pytest.approx(0.1)


@pytest.mark.parametrize('text', ['', '[1]', '{"mean_c": 20}', 'nonsense'])
def test_damaged_file_is_named(tmp_path, text):
    (tmp_path / TEMPERATURE_FILE).write_text(text)
    with pytest.raises(FileError, match=TEMPERATURE_FILE):
        load_temperature(tmp_path)


def test_impossible_temperature_is_named(tmp_path):
    with pytest.raises(FileError, match='temperature: 900'):
        measured(900.0).applied_to(Conditions(), tmp_path / TEMPERATURE_FILE)
