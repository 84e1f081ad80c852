# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The runner of the figures judges by itself, and never in favour of a missing value."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from bench import at_least
from bench import at_most
from bench import Number
from bench.runner import main

HEADER = 'from bench import Number, at_least, at_most\n'
GOOD = "def run():\n    return [Number('rms', 0.02, 'mm', at_most(0.05), 'sphere')]\n"
BAD = "def run():\n    yield Number('points', 10, '', at_least(40000))\n"
BROKEN = "def run():\n    raise RuntimeError('no camera')\n"


@pytest.fixture
def groups(tmp_path: Path) -> Path:
    folder = tmp_path / 'groups'
    folder.mkdir()
    return folder


def add(folder: Path, name: str, body: str) -> None:
    (folder / f'bench_{name}.py').write_text(HEADER + body)


def run(groups: Path, *names: str) -> tuple[int, Path]:
    output = groups.parent / 'out'
    return main([*names, '-o', str(output)], folder=groups), output


@pytest.mark.parametrize(
    ('bar', 'value', 'ok'),
    [
        (at_most(0.05), 0.05, True),
        (at_most(0.05), 0.0501, False),
        (at_least(40000), 40000, True),
        (at_least(40000), 39999, False),
        (None, 1.0, None),
    ],
)
def test_ok_follows_from_value_and_bar(bar, value, ok):
    assert Number('x', value, 'mm', bar).ok is ok


def test_figure_of_numpy_is_written_as_any_other():
    entry = Number('a', np.median(np.array([0.5])), 'mm', at_most(np.float64(1.0))).as_dict()
    assert json.loads(json.dumps(entry))['ok'] is True


@pytest.mark.parametrize('bar', [at_most(1.0), at_least(-1.0)])
@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf])
def test_value_that_is_not_finite_is_never_ok(bar, value):
    assert Number('x', value, 'mm', bar).ok is False


@pytest.mark.parametrize('limit', [math.nan, math.inf])
def test_bar_that_everything_or_nothing_meets_is_refused(limit):
    with pytest.raises(ValueError, match='finite'):
        at_most(limit)


def test_ok_cannot_be_claimed():
    with pytest.raises(TypeError):
        Number('x', 1.0, 'mm', ok=True)


def test_large_and_small_bars_read_as_written():
    assert str(at_least(300000)) == '>= 300000'
    assert str(at_most(0.05)) == '<= 0.05'


def test_results_are_written(groups):
    add(groups, 'stripe', GOOD)
    code, output = run(groups, 'stripe')
    assert code == 0
    assert json.loads((output / 'stripe.json').read_text()) == [
        {
            'name': 'rms',
            'value': 0.02,
            'unit': 'mm',
            'bar': '<= 0.05',
            'ok': True,
            'note': 'sphere',
        }
    ]


def test_note_in_brackets_is_printed(groups, capsys):
    add(groups, 'a', "def run():\n    yield Number('rms', 1, 'mm', note='[left]')\n")
    run(groups)
    assert '[left]' in capsys.readouterr().out


def test_missed_bar_fails_after_all_groups_ran(groups):
    add(groups, 'a', BAD)
    add(groups, 'b', GOOD)
    code, output = run(groups)
    assert code == 1
    assert json.loads((output / 'a.json').read_text())[0]['ok'] is False
    assert (output / 'b.json').exists()


def test_long_group_runs_only_by_its_name(groups):
    add(groups, 'a', GOOD)
    add(groups, 'faults', GOOD)
    _, output = run(groups)
    assert not (output / 'faults.json').exists()
    run(groups, 'faults')
    assert (output / 'faults.json').exists()


def test_nan_is_written_as_null(groups):
    add(groups, 'a', "def run():\n    yield Number('rms', float('nan'), 'mm', at_most(1))\n")
    code, output = run(groups)
    entry = json.loads((output / 'a.json').read_text())[0]
    assert code == 1
    assert entry['value'] is None
    assert entry['ok'] is False


def test_broken_group_fails_and_leaves_no_old_result(groups, capsys):
    add(groups, 'a', GOOD)
    run(groups)
    add(groups, 'a', BROKEN)
    add(groups, 'b', GOOD)
    code, output = run(groups)
    assert code == 1
    assert 'no camera' in capsys.readouterr().out
    assert not (output / 'a.json').exists()
    assert (output / 'b.json').exists()


@pytest.mark.parametrize('result', ['[]', '[0.02]'])
def test_group_without_figures_fails(groups, result):
    add(groups, 'a', f'def run():\n    return {result}\n')
    code, output = run(groups)
    assert code == 1
    assert not (output / 'a.json').exists()


def test_unknown_group_is_an_error_that_lists_the_existing(groups, capsys):
    add(groups, 'stripe', GOOD)
    add(groups, 'mesh', GOOD)
    code, output = run(groups, 'stripes')
    error = capsys.readouterr().err
    assert code == 1
    assert 'stripes' in error
    assert 'mesh, stripe' in error
    assert not output.exists()
