# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import pytest
from rosbags.rosbag2 import CompressionFormat
from rosbags.rosbag2 import CompressionMode
from rosbags.rosbag2 import StoragePlugin
from support.foreign_bags import write_rosbag2
import yaml
import zstandard

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.bag.locate import find_files
from ivfmc_ros.storage.bag.reader import open_bag


def contents(path, **options):
    bag = open_bag(path, **options)
    return [(raw.topic, raw.log_time_ns, raw.data) for raw in bag.messages(list(bag.topics))]


@pytest.mark.parametrize('storage', [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize('mode', [CompressionMode.FILE, CompressionMode.MESSAGE])
def test_bag_that_rosbag2_compressed_is_read(write_bag, tmp_path, storage, mode):
    source = write_bag(count=4)
    target = tmp_path / 'packed'
    write_rosbag2(source, target, storage=storage, compression=(mode, CompressionFormat.ZSTD))
    assert sorted(contents(target)) == sorted(contents(source))


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
    assert contents(file) == contents(source)


def test_file_that_was_replaced_is_read_again(compressed, write_bag):
    file, _ = compressed
    contents(file)
    other = write_bag(count=3, name='other')
    [plain] = other.glob('*.mcap')
    file.write_bytes(zstandard.ZstdCompressor().compress(plain.read_bytes()))
    assert contents(file) == contents(other)


def test_compressed_file_that_ends_early_is_refused_or_salvaged(compressed):
    file, source = compressed
    data = file.read_bytes()
    file.write_bytes(data[: len(data) // 2])
    with pytest.raises(BagError, match='is cut off'):
        contents(file)
    salvaged = contents(file, salvage=True)
    assert 0 < len(salvaged) < len(contents(source))
    assert set(salvaged) <= set(contents(source))


def test_compressed_file_without_a_whole_block_is_named(compressed):
    file, _ = compressed
    file.write_bytes(file.read_bytes()[:8])
    with pytest.raises(BagError, match=r'cannot be decompressed by zstd \(it ends early\)'):
        contents(file, salvage=True)


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
        contents(target)


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


def test_compressed_file_is_no_file_to_repair_or_to_copy(compressed):
    file, _ = compressed
    for path in (file, file.parent):
        with pytest.raises(BagError, match=r'bag_0\.mcap\.zstd: is compressed as a whole'):
            find_files(path)
