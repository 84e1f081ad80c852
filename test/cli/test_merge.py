# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import json

from click.testing import CliRunner
import numpy as np
import pytest
from support.clampings import lying
from support.erring_table import profiles_of
from support.erring_table import stripes
from support.erring_table import turns

from ivfmc_ros.cli import merge as command
from ivfmc_ros.errors import AmbiguousError
from ivfmc_ros.errors import CatalogueError
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.simulation.parts.solids import demo_part

STEPS = 80


def run(*arguments):
    return CliRunner().invoke(command.merge, [str(item) for item in arguments])


def retrieving(monkeypatch, part):
    """The catalogue knows the scans 'up' and 'down' of a part."""
    cell, sweeps = bench_cell(), turns(STEPS, np.zeros_like)
    places = {'up': np.eye(4), 'down': lying(part, 0)}

    def load_profiles(root, scan_id, cell_path=None, camera_path=None):
        measured = stripes(cell, part.moved(places[scan_id]), sweeps, 1)
        return profiles_of(cell, measured, sweeps), cell

    monkeypatch.setattr(command, 'load_profiles', load_profiles)


@pytest.mark.slow
def test_two_scans_become_one_mesh(tmp_path, monkeypatch):
    retrieving(monkeypatch, demo_part())
    answer = run('up', 'down', '-o', tmp_path / 'out', '--voxel', 1.5)
    assert answer.exit_code == 0, answer.exception
    assert 'down placed on up' in answer.output
    report = json.loads((tmp_path / 'out' / 'report.json').read_text())
    assert [entry['name'] for entry in report['merge']] == ['up', 'down']
    assert report['merge'][1]['rms'] < 1e-4
    assert report['counts']['views'] == 4
    for name in ('mesh.stl', 'mesh.ply', 'cloud.ply', 'report.html', 'cloud.png'):
        assert (tmp_path / 'out' / name).stat().st_size > 1000


@pytest.mark.slow
def test_an_ambiguous_part_leaves_no_folder(tmp_path, monkeypatch):
    retrieving(monkeypatch, box((0.044, 0.030, 0.060)))
    answer = run('up', 'down', '-o', tmp_path / 'out')
    assert isinstance(answer.exception, AmbiguousError)
    assert '180.0 degrees' in str(answer.exception)
    assert not (tmp_path / 'out').exists()


@pytest.mark.parametrize(
    ('sources', 'error'),
    [
        ((), ParameterError),
        (('no/such/bag', 'other'), FileError),
        (('one', 'two'), CatalogueError),
    ],
)
def test_what_cannot_be_merged_is_refused(tmp_path, sources, error):
    answer = run(*sources, '-o', tmp_path / 'out', '--scans', tmp_path)
    assert isinstance(answer.exception, error)
