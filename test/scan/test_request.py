# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import json
import math

import pytest

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.scan.request import ScanRequest


def test_request_is_serializable():
    request = ScanRequest(part='bracket', lasers=('left',))
    assert json.loads(json.dumps(request.as_dict()))['lasers'] == ['left']


@pytest.mark.parametrize(
    'name', ['', '../x', ';id;', 'a/b', '.hidden', 'a..b', 'a b', 'x' * 64, 'a\n', '-rf', 'ä']
)
def test_invalid_part_name_is_refused(name):
    with pytest.raises(ParameterError, match=r'part: .* is not a valid name'):
        ScanRequest(part=name)


def test_invalid_recipe_name_is_refused():
    with pytest.raises(ParameterError, match='recipe'):
        ScanRequest(recipe='../x')


@pytest.mark.parametrize(
    ('values', 'key'),
    [
        ({'views': 0}, 'views'),
        ({'profiles': 2}, 'profiles'),
        ({'overlap': -0.1}, 'overlap'),
        ({'closure': -0.1}, 'closure'),
        ({'closure': math.nan}, 'closure'),
        ({'overlap': math.nan}, 'overlap'),
        ({'motion': 'jump'}, 'motion'),
        ({'formats': ('exe',)}, 'formats'),
        ({'formats': ()}, 'formats'),
        ({'export_unit': 'ell'}, 'export_unit'),
        ({'lasers': ('left', 'left')}, 'lasers'),
        ({'exposures': (0.0,)}, 'exposures'),
        ({'exposures': (0.002, math.nan)}, 'exposures'),
        ({'exposures': (1.5,)}, 'exposures'),
        ({'exposures': (0.008, 0.002)}, 'exposures'),
        ({'exposures': (0.002, 0.002)}, 'exposures'),
        ({'exposures': (1e-3, 2e-3, 3e-3, 4e-3, 5e-3, 6e-3)}, 'exposures'),
    ],
)
def test_value_out_of_range_is_refused_by_its_name(values, key):
    with pytest.raises(ParameterError, match=f'^{key}:'):
        ScanRequest(**values)
