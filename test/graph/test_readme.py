# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The commands of the README, pasted in order into a shell, as a new user does."""

import os
from pathlib import Path
import re
import subprocess
import sys

import pytest
from support.graph_rig import node_environment
from support.house import ROOT

pytest.importorskip('rclpy')

BLOCK = re.compile(r'<!-- run: ([\w-]+) -->\n```sh\n(.*?)```', re.DOTALL)
BLOCKS = dict(BLOCK.findall((ROOT / 'README.md').read_text(encoding='utf-8')))
# What is shortened, so that `make test` stays short: the same commands on fewer pictures.
SHORTER = {'--steps 40': '--steps 16'}


def environment() -> dict[str, str]:
    """What `. .venv/bin/activate` gives, in the domain of this test run."""
    found = node_environment()
    scripts = Path(sys.executable).parent
    return {**found, 'PATH': f'{scripts}{os.pathsep}{found["PATH"]}'}


def paste(name: str, folder: Path) -> str:
    """Run a block of the README in ``folder`` and return what it printed."""
    commands = BLOCKS[name]
    for given, shorter in SHORTER.items():
        commands = commands.replace(given, shorter)
    result = subprocess.run(
        ['bash', '-m', '-e', '-c', commands],
        cwd=folder,
        env=environment(),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert result.returncode == 0, f'{result.stdout}\n{result.stderr}'
    # nothing that README pastes gives cause for a warning
    assert 'warning' not in result.stderr, result.stderr
    return result.stdout


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp('readme')


def test_every_block_is_tested():
    assert set(BLOCKS) == {'replay', 'replay-nodes', 'controller'}


def test_a_bag_becomes_a_mesh(folder):
    printed = paste('replay', folder)
    assert 'mesh to CAD: rms' in printed
    for name in ('mesh.stl', 'mesh.ply', 'cloud.ply', 'report.json', 'report.html'):
        assert (folder / 'rebuilt' / name).stat().st_size > 0


@pytest.mark.slow
def test_the_bag_goes_through_the_nodes(folder):
    if not (folder / 'recorded').exists():
        paste('replay', folder)
    assert 'pictures became' in paste('replay-nodes', folder)
    assert (folder / 'rebuilt_by_nodes' / 'mesh.stl').stat().st_size > 0


@pytest.mark.slow
def test_a_cell_controller_scans(folder, start):
    start('--simulate', '--set', 'mesher.mesh.voxel=0.001')
    printed = paste('controller', folder)
    assert '_bracket: ' in printed and ' profiles in 2 view(s)' in printed
    assert '"code": "OK"' in printed
