# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import pytest
import yaml

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.bag.metadata import bag_files


def _write(folder, **changes):
    info = {
        'version': 9,
        'storage_identifier': 'mcap',
        'relative_file_paths': ['b_0.mcap', 'b_1.mcap'],
        'compression_mode': '',
        **changes,
    }
    (folder / 'metadata.yaml').write_text(yaml.safe_dump({'rosbag2_bagfile_information': info}))
    return folder


def test_files_of_a_split_bag_are_in_order(tmp_path):
    assert bag_files(_write(tmp_path)) == [tmp_path / 'b_0.mcap', tmp_path / 'b_1.mcap']


@pytest.mark.parametrize('storage', ['sqlite3', ''])
def test_bag_of_sqlite_is_accepted(tmp_path, storage):
    folder = _write(tmp_path, storage_identifier=storage, relative_file_paths=['b_0.db3'])
    assert bag_files(folder) == [folder / 'b_0.db3']


def test_unknown_storage_is_refused_by_name(tmp_path):
    with pytest.raises(BagError, match="stored as 'tape', only mcap and sqlite3 can be read; con"):
        bag_files(_write(tmp_path, storage_identifier='tape'))


@pytest.mark.parametrize('name', ['../b_0.mcap', '/elsewhere/b_0.mcap', 'bag/b_0.mcap'])
def test_no_file_outside_of_the_bag_belongs_to_it(tmp_path, name):
    folder = _write(tmp_path, relative_file_paths=[name])
    assert bag_files(folder) == [tmp_path / 'b_0.mcap']


def test_file_that_is_listed_twice_is_named(tmp_path):
    folder = _write(tmp_path, relative_file_paths=['b_0.mcap', 'b_0.mcap'])
    with pytest.raises(BagError, match=r'relative_file_paths: has b_0\.mcap more than once'):
        bag_files(folder)


def test_bag_without_files_is_refused(tmp_path):
    with pytest.raises(BagError, match='relative_file_paths: must be a list'):
        bag_files(_write(tmp_path, relative_file_paths=[]))


@pytest.mark.parametrize(('text', 'problem'), [('{', 'is not valid YAML'), ('a: 1', 'is missing')])
def test_invalid_metadata_is_named(tmp_path, text, problem):
    (tmp_path / 'metadata.yaml').write_text(text)
    with pytest.raises(BagError, match=rf'metadata\.yaml: .*{problem}'):
        bag_files(tmp_path)


def test_folder_that_is_not_a_bag_is_named(tmp_path):
    with pytest.raises(BagError, match=r'has no metadata\.yaml and is not a bag') as caught:
        bag_files(tmp_path)
    assert str(tmp_path) in str(caught.value)
