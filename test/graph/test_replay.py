# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag through the nodes gives what it gives offline."""

import subprocess
import sys

import numpy as np
import pytest
from sensor_msgs.msg import Image
from sensor_msgs.msg import PointCloud2
from support.cell_rig import gone
from support.graph_rig import node_environment

from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.meshing.build import MeshSettings
from ivfmc_ros.pipeline import reconstruct
from ivfmc_ros.pipeline import Settings
from ivfmc_ros.results import merged_cloud
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.solids import demo_part
from ivfmc_ros.simulation.recording import record_scan
from ivfmc_ros.simulation.render.renderer import simulate_scan
from ivfmc_ros.storage.messages.point_clouds import to_structured_array
from ivfmc_ros.storage.scans.scan_bag import open_scan

STEPS = 24
VOXEL = 0.0006
LASERS = ('left', 'right')


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """A bag of 24 images per laser of the demo part, with cell.yaml beside it."""
    folder = tmp_path_factory.mktemp('bag')
    cell = bench_cell()
    save_cell(folder / 'cell.yaml', cell)
    record_scan(folder / 'bag', cell, simulate_scan(cell, demo_part(), STEPS))
    return folder / 'bag'


@pytest.fixture(scope='module')
def cell(start_shared, client, bag):
    # no parameter files: the defaults of the offline pipeline, with a coarse mesh
    return start_shared(
        '--replay', '--cell', bag.parent / 'cell.yaml', '--config', bag.parent,
        '--set', f'mesher.mesh.voxel={VOXEL}',
    )  # fmt: skip


def replay(bag, *options):
    return subprocess.run(
        [sys.executable, '-m', 'ivfmc_ros.cli.main', 'replay', str(bag), *map(str, options)],
        env=node_environment(),
        capture_output=True,
        text=True,
        timeout=150,
        check=False,
    )


# without /clock after a replay with it: nodes must return to their own clock
@pytest.mark.parametrize('options', [['--clock'], pytest.param([], marks=pytest.mark.slow)])
def test_replayed_cloud_equals_the_offline_cloud(client, cell, bag, tmp_path, options):
    settings = Settings(mesh=MeshSettings(voxel=VOXEL))
    offline = reconstruct(bench_cell(), open_scan(bag, lasers=LASERS).frames(), settings)
    points, _ = merged_cloud(offline)
    clouds = client.collect(PointCloud2, 'cloud')
    answer = replay(bag, '-o', tmp_path / 'out', *options)
    assert answer.returncode == 0, answer.stderr + cell.log()
    assert f'{2 * STEPS} pictures became {2 * STEPS} profiles' in answer.stdout
    client.until(lambda: clouds, 10.0, 'no cloud')
    records = to_structured_array(clouds[-1], 'cloud', ('x', 'y', 'z')).ravel()
    replayed = np.stack([records[name] for name in ('x', 'y', 'z')], axis=1)
    assert len(replayed) == len(points)
    np.testing.assert_allclose(replayed, points, atol=1e-8)
    assert (tmp_path / 'out' / 'mesh.stl').is_file()


def test_replay_is_refused_while_another_node_publishes_a_topic(client, cell, bag):
    publisher = client.publisher(Image, 'image_raw')
    try:
        answer = replay(bag)
    finally:
        client.node.destroy_publisher(publisher)
    assert answer.returncode == 1
    assert 'image_raw is published by /ivfmc/client' in answer.stderr


def test_missing_bag_is_refused(bag, tmp_path):
    answer = replay(tmp_path / 'nothing')
    assert answer.returncode == 1
    assert 'nothing' in answer.stderr


def test_replay_cell_ends_without_orphans(cell):
    assert cell.end() == 0
    assert gone(cell)
