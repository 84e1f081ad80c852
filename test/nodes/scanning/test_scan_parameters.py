# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Lasers that the orchestrator refuses to the caller that sets them."""

import pytest

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.nodes.scanning.scan_parameters import require_lasers


@pytest.fixture
def before(cell_file):
    return {'cell': str(cell_file), 'lasers': [], 'part': 'x'}


def test_laser_that_is_not_in_the_cell_is_refused(before):
    with pytest.raises(ParameterError, match=r"lasers: 'top' is not a laser of .*cell\.yaml"):
        require_lasers(before, {**before, 'lasers': ['top']})


def test_lasers_of_the_cell_and_an_empty_name_are_accepted(before, cell):
    require_lasers(before, {**before, 'lasers': [cell.lasers[1].name]})
    require_lasers(before, {**before, 'lasers': ['']})


def test_cell_without_the_chosen_lasers_is_refused(before, cell_file):
    before = {**before, 'cell': '', 'lasers': ['top']}
    with pytest.raises(ParameterError, match='set lasers and cell together'):
        require_lasers(before, {**before, 'cell': str(cell_file)})


def test_lasers_are_not_judged_without_a_readable_cell(before, tmp_path):
    require_lasers(before, {**before, 'cell': '', 'lasers': ['top']})
    require_lasers(before, {**before, 'cell': str(tmp_path / 'none'), 'lasers': ['top']})


def test_other_parameters_can_be_set_after_the_cell_has_changed(before):
    before = {**before, 'lasers': ['gone']}
    require_lasers(before, {**before, 'part': 'y'})
