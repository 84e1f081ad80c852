# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of recordings that were interrupted are read as far as they go, and say so."""

import pytest
import yaml

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.bag.locate import find_files
from ivfmc_ros.storage.bag.reader import open_bag
from ivfmc_ros.storage.bag.writer import BagWriter
from ivfmc_ros.storage.scans.scan_bag import open_scan


@pytest.fixture
def interrupted(tmp_path, camera, make_image):
    """Folder of a recording that was killed: three images in scan.mcap.part."""
    folder = tmp_path / 'killed'
    folder.mkdir()
    bag = BagWriter(folder, chunk_bytes=None)
    for index in range(4):
        bag.joint_state(100_000_000 * index, 'turntable_joint', 0.1 * index)
        bag.camera_info(100_000_000 * index, camera)
        bag.image(100_000_000 * index, make_image(index))
        if index < 3:
            bag.flush()
    bag.close()
    return folder


@pytest.mark.parametrize('form', ['folder', 'file'])
def test_bag_without_metadata_is_read_and_said(write_bag, form):
    folder = write_bag()
    (folder / 'metadata.yaml').unlink()
    scan = open_scan(folder if form == 'folder' else folder / 'scan.mcap')
    assert scan.frame_count == 5
    said = f'{folder}: has no metadata.yaml; scan.mcap is read without it'
    assert scan.bag.remarks == ((said,) if form == 'folder' else ())


@pytest.mark.parametrize('form', ['folder', 'file'])
def test_interrupted_recording_is_read_as_far_as_it_goes(interrupted, form):
    scan = open_scan(interrupted if form == 'folder' else interrupted / 'scan.mcap.part')
    assert scan.frame_count == len(list(scan.frames())) == 3
    said = ' '.join(scan.bag.remarks)
    assert 'scan.mcap.part: the recording was not finished' in said
    assert '9 messages can be read (3 on /ivfmc/camera_info, 3 on' in said


@pytest.mark.parametrize(
    ('lie', 'said'),
    [
        (('message_count: 5', 'message_count: 7'), 'states 7 messages of /ivfmc/camera_info, the'),
        (('name: /ivfmc/image_raw', 'name: /other'), 'states 0 messages of /ivfmc/image_raw, the'),
        (('message_count: 5', 'message_count: many'), 'topics_with_message_count: is not valid'),
    ],
)
def test_lying_metadata_is_said_and_the_files_are_read(write_bag, lie, said):
    folder = write_bag()
    path = folder / 'metadata.yaml'
    path.write_text(path.read_text().replace(*lie))
    scan = open_scan(folder)
    assert scan.frame_count == 5
    [remark] = scan.bag.remarks
    assert f'metadata.yaml: {said}' in remark
    assert remark.endswith('; the files are read')


def test_split_recording_without_metadata_is_read_in_its_order(write_bag, tmp_path):
    bag = tmp_path / 'split'
    bag.mkdir()
    for index in range(11):
        (write_bag(f'b{index}', count=1) / 'scan.mcap').rename(bag / f'split_{index}.mcap')
    files, remark = find_files(bag)
    assert [file.name for file in files] == [f'split_{index}.mcap' for index in range(11)]
    assert 'has no metadata.yaml' in remark
    assert open_bag(bag).topics['/ivfmc/image_raw'].count == 11


def test_several_bags_in_one_folder_are_refused_by_name(write_bag, tmp_path):
    folder = write_bag()
    (folder / 'metadata.yaml').unlink()
    (write_bag('other') / 'scan.mcap').rename(folder / 'other.mcap')
    with pytest.raises(BagError, match=r'says which files .* name one of other\.mcap, scan\.mcap'):
        open_bag(folder)


def test_folder_without_a_bag_is_refused(tmp_path):
    with pytest.raises(BagError, match=r'has no metadata\.yaml and is not a bag'):
        open_bag(tmp_path)


@pytest.mark.parametrize('mark', ['', '\ufeff'])
def test_bag_that_was_reindexed_has_no_storage_identifier(write_bag, mark):
    folder = write_bag()
    path = folder / 'metadata.yaml'
    document = yaml.safe_load(path.read_text())
    document['rosbag2_bagfile_information']['storage_identifier'] = ''
    path.write_text(mark + yaml.safe_dump(document), encoding='utf-8')
    assert open_scan(folder).frame_count == 5
