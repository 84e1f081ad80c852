# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import pytest
from rosbags.rosbag2 import CompressionFormat
from rosbags.rosbag2 import CompressionMode
from rosbags.rosbag2 import StoragePlugin
from support.foreign_bags import write_rosbag2
from support.recordings import messages_of
import yaml
import zstandard

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.bag.reader import open_bag


@pytest.mark.parametrize('storage', [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize('mode', [CompressionMode.FILE, CompressionMode.MESSAGE])
def test_bag_that_rosbag2_compressed_is_read(write_bag, tmp_path, storage, mode):
    source = write_bag(count=4)
    target = tmp_path / 'packed'
    write_rosbag2(source, target, storage=storage, compression=(mode, CompressionFormat.ZSTD))
    assert sorted(messages_of(target)) == sorted(messages_of(source))


@pytest.fixture
def compressed(write_bag, tmp_path):
    """A file that was compressed as a whole, and the bag that it was."""
    source = write_bag(count=1200)
    [plain] = source.glob('*.mcap')
    file = tmp_path / 'bag_0.mcap.zstd'
    file.write_bytes(zstandard.ZstdCompressor().compress(plain.read_bytes()))
    return file, source


def test_file_that_is_compressed_as_a_whole_is_read(compressed):
    file, source = compressed
    assert messages_of(file) == messages_of(source)


def test_file_that_was_replaced_is_read_again(compressed, write_bag):
    file, _ = compressed
    messages_of(file)
    other = write_bag(count=3, name='other')
    [plain] = other.glob('*.mcap')
    file.write_bytes(zstandard.ZstdCompressor().compress(plain.read_bytes()))
    assert messages_of(file) == messages_of(other)


def test_compressed_file_that_ends_early_is_refused_or_salvaged(compressed):
    file, source = compressed
    data = file.read_bytes()
    file.write_bytes(data[: len(data) // 2])
    with pytest.raises(BagError, match=r'bag_0\.mcap\.zstd: the file is cut off') as caught:
        messages_of(file)
    # the file that the user named, not its copy
    assert str(caught.value).startswith(str(file))
    salvaged = messages_of(file, salvage=True)
    assert 0 < len(salvaged) < len(messages_of(source))
    assert set(salvaged) <= set(messages_of(source))


def test_compressed_file_without_a_whole_block_is_named(compressed):
    file, _ = compressed
    file.write_bytes(file.read_bytes()[:8])
    with pytest.raises(BagError, match=r'cannot be decompressed by zstd \(it ends early\)'):
        messages_of(file, salvage=True)


def test_file_that_is_not_of_zstd_is_named(tmp_path):
    file = tmp_path / 'bag_0.mcap.zst'
    file.write_bytes(b'not compressed at all')
    with pytest.raises(BagError, match=r'bag_0\.mcap\.zst: cannot be decompressed by zstd'):
        open_bag(file)


def test_damaged_message_is_named(write_bag, tmp_path):
    source, target = write_bag(count=4), tmp_path / 'packed'
    mode = (CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    write_rosbag2(source, target, storage=StoragePlugin.MCAP, compression=mode, cut=3)
    with pytest.raises(BagError, match=r'message 0 cannot be decompressed by zstd \(it ends'):
        messages_of(target)


@pytest.mark.parametrize(('mode', 'method'), [('file', 'xz'), ('stream', 'zstd')])
def test_other_compression_is_refused_by_name(write_bag, mode, method):
    folder = write_bag(count=2)
    path = folder / 'metadata.yaml'
    document = yaml.safe_load(path.read_text())
    info = document['rosbag2_bagfile_information']
    info['compression_mode'], info['compression_format'] = mode, method
    path.write_text(yaml.safe_dump(document))
    with pytest.raises(BagError, match=f"compressed the bag by '{mode}' '{method}', only file"):
        open_bag(folder)


def test_copy_is_removed_with_the_last_bag_that_reads_it(compressed):
    file, _ = compressed
    first, second = open_bag(file), open_bag(file)
    [copy] = {read.path for bag in (first, second) for read in bag.files}
    assert copy.exists()
    del first
    assert copy.exists()
    del second
    assert not copy.parent.exists()


def test_message_that_is_compressed_by_itself_is_read_without_metadata(write_bag, tmp_path):
    source, target = write_bag(count=4), tmp_path / 'packed'
    mode = (CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    write_rosbag2(source, target, storage=StoragePlugin.MCAP, compression=mode)
    [file] = target.glob('*.mcap')
    assert sorted(messages_of(file)) == sorted(messages_of(source))
