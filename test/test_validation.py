# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import math

import pytest

from ivfmc_ros.errors import CellError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.validation import require_in_range
from ivfmc_ros.validation import require_one_of


@pytest.mark.parametrize('value', [0.0, 0.5, 1.0, 1])
def test_limits_of_a_closed_range_are_accepted(value):
    require_in_range('power', value, 0.0, 1.0)


@pytest.mark.parametrize('value', [-0.1, 1.1, math.nan, math.inf])
def test_number_outside_of_its_range_is_refused(value):
    with pytest.raises(ParameterError, match=rf'^power: {value} is out of range; .* be 0 to 1 W$'):
        require_in_range('power', value, 0.0, 1.0, 'W')


@pytest.mark.parametrize(
    ('value', 'limits', 'text'),
    [
        (0.0, {'open_low': True}, 'above 0, up to 10 m'),
        (10.0, {'open_high': True}, '0 to below 10 m'),
        (10.0, {'open_low': True, 'open_high': True}, 'above 0, up to below 10 m'),
    ],
)
def test_open_limits_are_refused(value, limits, text):
    with pytest.raises(ParameterError, match=f'it must be {text}$'):
        require_in_range('radius', value, 0.0, 10.0, 'm', **limits)


def test_range_without_upper_limit_may_demand_a_finite_number():
    require_in_range('gain', math.inf, 0, math.inf)
    with pytest.raises(ParameterError, match=r'gain: inf is out of range; it must be at least 0$'):
        require_in_range('gain', math.inf, 0, math.inf, open_high=True)
    with pytest.raises(ParameterError, match=r'gain: 0 is out of range; it must be above 0$'):
        require_in_range('gain', 0, 0, math.inf, open_low=True)


def test_large_whole_limits_are_written_out():
    with pytest.raises(ParameterError, match=r'must be 0 to 10000000 triangles'):
        require_in_range('island', -1, 0, 10_000_000, 'triangles')


def test_text_that_is_no_choice_is_refused():
    require_one_of('unit', 'mm', ('m', 'mm'))
    with pytest.raises(ParameterError, match=r"^unit: 'cm' is not one of m, mm$"):
        require_one_of('unit', 'cm', {'m': 1.0, 'mm': 1e-3})


def test_kind_of_error_is_chosen_by_the_caller():
    with pytest.raises(CellError, match=r'^thickness: nan is out of range'):
        require_in_range('thickness', math.nan, 0.0, 0.01, error=CellError)
    with pytest.raises(CellError, match=r'^model'):
        require_one_of('model', 'fisheye', ('plumb_bob',), error=CellError)
