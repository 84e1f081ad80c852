# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import math
import re

import pytest

from ivfmc_ros.inspection.reports.tables import tables


def rows(html):
    """The cells of each row, tags taken off."""
    cells = (re.findall(r'<t[dh]>(.*?)</t[dh]>', row) for row in re.findall('<tr>.*?</tr>', html))
    return [[re.sub('<.*?>', '', cell.replace('<br>', '|')) for cell in row] for row in cells]


@pytest.mark.parametrize(
    ('key', 'value', 'shown'),
    [
        ('rms_before', 5.31e-6, ['rms before, mm', '0.0053']),
        ('form_m', 1.5e-5, ['form, mm', '0.0150']),
        ('rotation', math.radians(0.25), ['rotation, deg', '0.250']),
        ('jitter', 2.3e-4, ['jitter, ms', '0.23']),
        ('speed', math.radians(20), ['speed, deg/s', '20.00']),
        ('center_xyz_m', [1e-3, -2e-3, 0.0], ['center xyz, mm', '1.0000, -2.0000, 0.0000']),
        ('T', [[1.0, 0.25], [0.0, 1e-9]], ['T', '1, 0.25|0, 1e-09']),
        ('faces', 1294636, ['faces', '1,294,636']),
        ('overlap', 0.9691679, ['overlap', '0.9692']),
        ('applied', False, ['applied', 'no']),
        ('rms_after', math.nan, ['rms after, mm', '']),
        ('why', '<table>', ['why', '&lt;table&gt;']),
    ],
)
def test_figures_are_shown_in_the_units_that_a_person_reads(key, value, shown):
    assert rows(tables({key: value})) == [shown]


def test_what_is_empty_is_left_out():
    rows_of_table = [{'view': 0, 'why': '', 'rms': None}, {'view': 1, 'why': '', 'rms': None}]
    html = tables({'advice': '', 'skipped': {}, 'lasers': None, 'views': rows_of_table})
    assert rows(html) == [['view'], ['0'], ['1']]
    assert 'skipped' not in html


def test_parts_come_below_what_has_none_and_are_a_level_lower():
    figures = {'mesh': {'paths': {'stl': 'a.stl'}, 'code': 'OK'}, 'seconds': {'meshing': 2.5}}
    html = tables(figures)
    heads = re.findall(r'<(h\d)>(.*?)</h', html)
    assert heads == [('h2', 'mesh'), ('h3', 'paths'), ('h2', 'seconds')]
    assert rows(html) == [['code', 'OK'], ['stl', 'a.stl'], ['meshing', '2.5']]


def test_verdict_has_its_color():
    html = tables({'features': [{'name': 'plane 1', 'verdict': 'not decided'}]})
    assert '<span class="not">not decided</span>' in html
