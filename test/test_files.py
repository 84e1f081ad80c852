# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import pytest

from ivfmc_ros import files
from ivfmc_ros.errors import FileError


def listing(folder):
    return sorted(path.name for path in folder.iterdir())


def test_file_appears_when_the_block_ends(tmp_path):
    with files.atomic_file(tmp_path / 'a.png') as temporary:
        temporary.write_bytes(b'whole')
        assert not (tmp_path / 'a.png').exists()
        assert temporary.suffix == '.png'
        assert temporary.name.startswith('.')
    assert (tmp_path / 'a.png').read_bytes() == b'whole'
    assert listing(tmp_path) == ['a.png']


def test_text_is_utf8(tmp_path):
    files.write_text(tmp_path / 'a.txt', 'σ = 1 µm\n')
    assert (tmp_path / 'a.txt').read_bytes() == 'σ = 1 µm\n'.encode()


def test_block_that_raises_leaves_no_file(tmp_path):
    (tmp_path / 'a.txt').write_text('before')
    with pytest.raises(KeyError), files.atomic_file(tmp_path / 'a.txt') as temporary:
        temporary.write_text('half')
        raise KeyError
    assert (tmp_path / 'a.txt').read_text() == 'before'
    assert listing(tmp_path) == ['a.txt']


def test_full_disk_is_named_and_leaves_nothing(tmp_path):
    def fill(path):
        with files.atomic_file(path) as temporary:
            temporary.write_text('half')
            Path('/dev/full').write_text('x')  # raises ENOSPC

    with pytest.raises(FileError, match=r'a\.txt: cannot be written: No space left'):
        fill(tmp_path / 'a.txt')
    assert listing(tmp_path) == []


def test_file_is_as_readable_as_any_other(tmp_path):
    (tmp_path / 'other.txt').touch()
    files.write_text(tmp_path / 'a.txt', 'x')
    assert (tmp_path / 'a.txt').stat().st_mode == (tmp_path / 'other.txt').stat().st_mode


def test_missing_folder_is_refused(tmp_path):
    with pytest.raises(FileError, match=r'none.a\.txt: cannot be written: No such file'):
        files.write_text(tmp_path / 'none' / 'a.txt', 'x')


def test_file_in_place_of_the_folder_is_refused(tmp_path):
    (tmp_path / 'a').write_text('')
    with pytest.raises(FileError, match=r'a.b\.txt: cannot be written: Not a directory'):
        files.write_text(tmp_path / 'a' / 'b.txt', 'x')


def test_folder_in_place_of_the_file_is_refused(tmp_path):
    (tmp_path / 'a.txt').mkdir()
    with pytest.raises(FileError, match=r'a\.txt: cannot be written: Is a directory'):
        files.write_text(tmp_path / 'a.txt', 'x')
    assert listing(tmp_path) == ['a.txt']


def test_folder_that_takes_no_files_is_refused():
    # also root cannot make a file here
    with pytest.raises(FileError, match=r'/proc/self/a\.txt: cannot be written'):
        files.write_text(Path('/proc/self/a.txt'), 'x')


def test_error_without_errno_is_reported(tmp_path):
    with (
        pytest.raises(FileError, match=r'a\.txt: cannot be written: the encoder failed'),
        files.atomic_file(tmp_path / 'a.txt'),
    ):
        raise OSError('the encoder failed')


def test_other_errors_of_the_block_are_raised(tmp_path):
    def fail():
        with files.atomic_file(tmp_path / 'a.txt'):
            raise FileError('b.txt: cannot be read')

    with pytest.raises(FileError, match=r'^b\.txt: cannot be read$'):
        fail()


def test_folder_appears_whole(tmp_path):
    with files.atomic_folder(tmp_path / 'made' / 'out') as temporary:
        (temporary / 'a.txt').write_text('x')
        assert not (tmp_path / 'made' / 'out').exists()
    assert listing(tmp_path / 'made' / 'out') == ['a.txt']
    assert listing(tmp_path / 'made') == ['out']


def test_block_that_raises_leaves_no_folder(tmp_path):
    with pytest.raises(KeyError), files.atomic_folder(tmp_path / 'out') as temporary:
        (temporary / 'a.txt').write_text('x')
        raise KeyError
    assert listing(tmp_path) == []


def test_empty_folder_is_filled(tmp_path):
    (tmp_path / 'out').mkdir()
    with files.atomic_folder(tmp_path / 'out') as temporary:
        (temporary / 'a.txt').write_text('x')
    assert listing(tmp_path / 'out') == ['a.txt']


@pytest.mark.parametrize('taken', ['out/a.txt', 'out'])
def test_folder_that_holds_something_is_refused(tmp_path, taken):
    (tmp_path / taken).parent.mkdir(exist_ok=True)
    (tmp_path / taken).write_text('mine')
    with (
        pytest.raises(FileError, match='out: exists already'),
        files.atomic_folder(tmp_path / 'out'),
    ):
        pytest.fail('it must not come to this')
    assert (tmp_path / taken).read_text() == 'mine'
