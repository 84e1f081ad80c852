# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A file that was mixed up with another is named as what it is."""

import pytest
from support.synthetic import small_camera
from support.synthetic import small_cell

from ivfmc_ros.angles import load_angles
from ivfmc_ros.angles import save_angles
from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.camera_file import save_camera
from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.errors import FileError
from ivfmc_ros.inspection.mesh_file import read_mesh
from ivfmc_ros.storage.bag.reader import open_bag
from ivfmc_ros.storage.bag.writer import create_bag
from ivfmc_ros.stripe.noise import SensorNoise
from ivfmc_ros.stripe.noise_file import load_noise
from ivfmc_ros.stripe.noise_file import save_noise

NAMES = {
    'camera.yaml': 'a camera calibration',
    'cell.yaml': 'a cell file',
    'angles.yaml': 'a file of table angles',
    'noise.yaml': 'a noise model',
    'scan.mcap': 'an MCAP bag',
    'metadata.yaml': 'the metadata.yaml of a bag',
    'mesh.stl': 'an STL mesh',
}
READERS = {
    'camera.yaml': load_camera,
    'cell.yaml': load_draft,
    'angles.yaml': load_angles,
    'noise.yaml': load_noise,
    'scan.mcap': open_bag,
    'mesh.stl': lambda path: read_mesh(path, 'mm'),
}


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp('kinds') / 'bag'
    with create_bag(folder) as bag:
        bag.joint_state(0, 'turntable_joint', 0.0)
    save_camera(folder / 'camera.yaml', small_camera())
    save_cell(folder / 'cell.yaml', small_cell())
    save_angles(folder / 'angles.yaml', {'a.png': 0.0})
    save_noise(folder / 'noise.yaml', SensorNoise())
    (folder / 'mesh.stl').write_text('solid a\nfacet normal 0 0 1\nouter loop\n')
    return folder


@pytest.mark.parametrize('given', NAMES)
@pytest.mark.parametrize('wanted', READERS)
def test_file_that_was_mixed_up_is_named(folder, given, wanted):
    if given == wanted:
        return
    with pytest.raises(FileError) as caught:
        READERS[wanted](folder / given)
    assert str(folder / given) in str(caught.value)
    assert NAMES[given] in str(caught.value)
