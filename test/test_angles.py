# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import pytest

from ivfmc_ros.angles import load_angles
from ivfmc_ros.angles import save_angles
from ivfmc_ros.errors import FileError


def test_angles_come_back_in_order(tmp_path):
    angles = {'step2.jpg': 1e-5, 'step10.jpg': -3.25, '7': 0.0}
    save_angles(tmp_path / 'angles.yaml', angles)
    loaded = load_angles(tmp_path / 'angles.yaml')
    assert loaded == angles
    assert list(loaded) == list(angles)


def test_hand_written_numbers_are_understood(tmp_path):
    path = tmp_path / 'a.yaml'
    path.write_text('version: 1\nangles: {a.jpg: 4e-5, b.jpg: 1, 3: 0.5}\n')
    assert load_angles(path) == {'a.jpg': 4e-5, 'b.jpg': 1.0, '3': 0.5}


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        ('version: 2\nangles: {a: 1}', 'version: must be 1, is 2'),
        ('angles: {a: 1}', 'version: must be 1, is None'),
        ('version: 1', 'angles: must be a mapping'),
        ('version: 1\nangles: {}', 'angles: must be a mapping'),
        ('version: 1\nangles: [1, 2]', 'angles: must be a mapping'),
        ('version: 1\nangles: {a.jpg: .nan}', r'a\.jpg: nan is not a finite number'),
        ('version: 1\nangles: {a.jpg: true}', r'a\.jpg: True is not a finite number'),
        ('version: 1\nangles: {a.jpg: left}', r"a\.jpg: 'left' is not a finite number"),
        ('version: 1\nangles: {a: 1}\nunit: deg', "unknown key 'unit'"),
        ('- 1', 'must be a mapping with the keys'),
        ('{', 'is not YAML'),
    ],
)
def test_file_and_key_of_what_is_wrong_are_named(tmp_path, text, problem):
    (tmp_path / 'a.yaml').write_text(text)
    with pytest.raises(FileError, match=rf'a\.yaml: .*{problem}|a\.yaml: {problem}'):
        load_angles(tmp_path / 'a.yaml')


def test_missing_file_is_named(tmp_path):
    with pytest.raises(FileError, match=r'none\.yaml: cannot be read: No such file'):
        load_angles(tmp_path / 'none.yaml')


def test_folder_that_is_missing_is_named(tmp_path):
    with pytest.raises(FileError, match='cannot be written'):
        save_angles(tmp_path / 'nowhere' / 'angles.yaml', {'a': 1.0})
