# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Tables and JSON on stdout, progress on stderr."""

import json
from pathlib import Path

from click.testing import CliRunner
import pytest
from rich.table import Table

from ivfmc_ros.cli.support import progress
from ivfmc_ros.cli.support.output import console
from ivfmc_ros.cli.support.output import print_json


def test_nothing_is_cut_off_a_terminal(capsys):
    table = Table()
    table.add_column('path')
    table.add_row('x' * 500)
    console().print(table)
    assert 'x' * 500 in capsys.readouterr().out


def test_file_names_are_no_markup(capsys):
    console().print('[bold]/tmp/[red]a')
    assert capsys.readouterr().out == '[bold]/tmp/[red]a\n'


def test_json_has_null_for_what_is_no_number(capsys):
    print_json({'a': float('nan'), 'b': [float('inf'), 1.5], 'c': Path('x')})
    assert json.loads(capsys.readouterr().out) == {'a': None, 'b': [None, 1.5], 'c': 'x'}


@pytest.fixture
def clock(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(progress.time, 'monotonic', lambda: now[0])
    return now


def test_progress_off_a_terminal_is_a_line_every_few_seconds(capsys, clock):
    with progress.progress_bars() as show:
        for done in range(100):
            clock[0] = 0.2 * done  # seconds
            show('pictures', done, 100)
    err = capsys.readouterr().err
    assert err.splitlines() == [
        'pictures: 10 of 100',
        'pictures: 35 of 100',
        'pictures: 60 of 100',
        'pictures: 85 of 100',
    ]


def test_progress_that_does_not_change_is_repeated_seldom(capsys, clock):
    with progress.progress_bars() as show:
        for second in range(60):
            clock[0] = float(second)
            show('meshing', 0, 1)
    assert capsys.readouterr().err.splitlines() == 2 * ['meshing: 0 of 1']


def test_a_short_job_prints_no_progress_off_a_terminal(capsys, clock):
    with progress.progress_bars() as show:
        show('pictures', 1, 2)
    assert capsys.readouterr().err == ''


def test_progress_of_a_new_stage_is_shown_at_once(capsys, clock):
    with progress.progress_bars() as show:
        clock[0] = 3.0
        show('pictures', 1, 2)
        show('meshing', 0, 1)
    assert capsys.readouterr().err.splitlines() == ['pictures: 1 of 2', 'meshing: 0 of 1']


@pytest.mark.parametrize(
    ('words', 'meant'),
    [
        (['recontruct'], 'reconstruct'),
        (['calibrate', 'lazer'], 'laser'),
        (['scans', 'lst'], 'list'),
    ],
)
def test_a_mistyped_command_is_named_with_the_one_that_is_meant(words, meant):
    from ivfmc_ros.cli.main import ivfmc

    result = CliRunner().invoke(ivfmc, words)
    assert result.exit_code == 2
    assert f"No such command '{words[-1]}'. Did you mean {meant}?" in result.output


def test_a_mistyped_option_is_named_with_the_one_that_is_meant():
    from ivfmc_ros.cli.main import ivfmc

    result = CliRunner().invoke(ivfmc, ['reconstruct', 'bag', '--radus', '5', '-o', 'x'])
    assert result.exit_code == 2
    assert '--radius' in result.output
