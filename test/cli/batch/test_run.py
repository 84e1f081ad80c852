# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import json

from click.testing import CliRunner
import numpy as np
import pytest
from support.synthetic import small_cell
from support.synthetic import Sphere
from support.synthetic import sphere_frames
import zstandard

from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.cli.reconstruct import reconstruct
from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.storage.bag.writer import create_bag
from ivfmc_ros.storage.catalogue.catalogue import Catalogue

CELL = small_cell()
SPHERE = Sphere(np.array([0.008, -0.005, 0.04]), 0.025)
STEPS = 40
START = 1_700_000_000_000_000_000


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    """A scan of a sphere, and a bag whose pictures show nothing."""
    root = tmp_path_factory.mktemp('bags')
    frames = sphere_frames(CELL, SPHERE, STEPS, seed=1)
    for name in ('sphere', 'black'):
        with create_bag(root / name) as bag:
            for frame in frames:
                stamp = START + frame.stamp_ns
                image = frame.image if name == 'sphere' else np.zeros_like(frame.image)
                bag.joint_state(stamp, CELL.turntable.joint, frame.angle)
                bag.laser_state(stamp - 30_000_000, {CELL.lasers[0].name: True})
                bag.camera_info(stamp, CELL.camera)
                bag.image(stamp, image)
    save_cell(root / 'cell.yaml', CELL)
    return root


def run(bags, output, *more):
    sources = [str(bags / name) for name in ('black', 'sphere')]
    options = ['--cell', str(bags / 'cell.yaml'), '-o', str(output), '--json', *more]
    return CliRunner().invoke(reconstruct, [*sources, *options])


def test_one_bag_that_fails_does_not_end_the_others_and_nothing_is_done_twice(bags, tmp_path):
    output = tmp_path / 'results'
    answer = run(bags, output)
    assert isinstance(answer.exception, HelperError)
    assert '1 of 2 failed, the first: black: NO_STRIPE' in str(answer.exception)
    assert sorted(path.name for path in output.iterdir()) == ['batch_summary.json', 'sphere']
    mesh = output / 'sphere' / 'mesh.stl'
    made = mesh.stat().st_mtime_ns
    summary = json.loads((output / 'batch_summary.json').read_text())
    assert [(row['name'], row['code'], row['is_new']) for row in summary] == [
        ('black', 'NO_STRIPE', False),
        ('sphere', 'OK', True),
    ]
    # again: what is there is kept
    run(bags, output)
    assert mesh.stat().st_mtime_ns == made
    # with other settings the folder is not taken for their result
    answer = run(bags, output, '--smoothing', '0')
    assert (
        'was made of another bag, cell or settings'
        in (json.loads((output / 'batch_summary.json').read_text())[1]['detail'])
    )
    assert mesh.stat().st_mtime_ns == made


def test_results_of_scan_folders_are_in_their_catalogue_once(bags, tmp_path):
    catalogue = Catalogue(bags, create=True)
    try:
        catalogue.add_scan('sphere', 'ball', '', 'DONE', {})
        for _ in range(2):
            run(bags, tmp_path / 'results')
        [result] = catalogue.results('sphere')
        assert result.folder == tmp_path / 'results' / 'sphere'
        assert result.summary['counts']['faces'] > 100
    finally:
        catalogue.close()
        catalogue.path.unlink()


def test_compressed_bags_have_names_of_their_own(bags, tmp_path):
    [plain] = (bags / 'sphere').glob('*.mcap')
    packed = bags / 'ball.mcap.zstd'
    packed.write_bytes(zstandard.ZstdCompressor().compress(plain.read_bytes()))
    try:
        options = ['--cell', str(bags / 'cell.yaml'), '-o', str(tmp_path / 'results')]
        sources = [str(packed), str(bags / 'sphere')]
        answer = CliRunner().invoke(reconstruct, [*sources, *options])
    finally:
        packed.unlink()
    assert answer.exit_code == 0, answer.exception
    meshes = [tmp_path / 'results' / name / 'mesh.stl' for name in ('ball', 'sphere')]
    assert meshes[0].read_bytes() == meshes[1].read_bytes()


def test_two_sources_of_one_name_are_refused(bags, tmp_path):
    source = str(bags / 'sphere')
    options = ['--cell', str(bags / 'cell.yaml'), '-o', str(tmp_path / 'results')]
    answer = CliRunner().invoke(reconstruct, [source, source, *options])
    assert isinstance(answer.exception, ParameterError)
    assert 'sphere: several sources have this name' in str(answer.exception)
