# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import math
import re

import pytest

from ivfmc_ros.inspection.reports.tables import folded
from ivfmc_ros.inspection.reports.tables import PRINTED_ROWS
from ivfmc_ros.inspection.reports.tables import tables
from ivfmc_ros.inspection.reports.tables import without_folders


def rows(html):
    """The cells of each row, tags taken off."""
    cells = (re.findall(r'<t[dh]>(.*?)</t[dh]>', row) for row in re.findall('<tr>.*?</tr>', html))
    return [[re.sub('<.*?>', '', cell.replace('<br>', '|')) for cell in row] for row in cells]


@pytest.mark.parametrize(
    ('key', 'value', 'shown'),
    [
        ('rms_before', 5.31e-6, ['rms before, mm', '0.0053']),
        ('deviation_m', -2e-9, ['deviation, mm', '0.0000']),
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


def test_folded_parts_have_the_content_of_sections():
    figures = {'code': 'OK', 'mesh': {'paths': {'stl': 'a.stl'}}, 'views': [{'view': 0}]}
    html = folded(figures, ('views',))
    assert re.findall(r'<details( open)?><summary><h2>(.*?)</h2>', html) == [
        ('', 'mesh'),
        (' open', 'views'),
    ]
    assert rows(html) == rows(tables(figures))


def test_long_table_is_printed_in_part_and_says_so():
    verdicts = ['pass'] * 50 + ['fail'] * 4
    html = tables({'features': [{'name': str(k), 'verdict': v} for k, v in enumerate(verdicts)]})
    printed = rows(html)[1:]
    assert len(printed) == PRINTED_ROWS
    assert [row[0] for row in printed] == [*map(str, range(20)), '50', '51', '52', '53']
    assert html.count('<tr class="unprinted">') == 30
    assert '30 more rows' in html


@pytest.mark.parametrize(
    ('text', 'shown'),
    [
        ('/tmp/a/b/mesh.stl', 'mesh.stl'),
        ('/tmp/a/cell.yaml: lasers: none', 'cell.yaml: lasers: none'),
        ('received on /ivfmc/laser_states', 'received on /ivfmc/laser_states'),
        ('a/b.stl', 'a/b.stl'),
        ('ratio 1/2', 'ratio 1/2'),
        ('/tmp', '/tmp'),
    ],
)
def test_no_folder_of_this_computer_is_shown(text, shown):
    assert without_folders(text) == shown
    assert rows(tables({'why': text})) == [['why', shown]]
