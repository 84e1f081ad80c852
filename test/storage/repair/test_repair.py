# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import random
import shutil

import numpy as np
import pytest
from rosbags.rosbag2 import CompressionFormat
from rosbags.rosbag2 import CompressionMode
from rosbags.rosbag2 import Reader
from rosbags.rosbag2 import StoragePlugin
from support.foreign_bags import write_ros1
from support.foreign_bags import write_rosbag2
from support.foreign_bags import write_sqlite
from support.recordings import messages_of
from support.recordings import START
from support.recordings import write_profiles
import zstandard

from ivfmc_ros.errors import BagError
from ivfmc_ros.errors import FileError
from ivfmc_ros.storage.bag.writer import BagWriter
from ivfmc_ros.storage.messages.profile_header import ProfileHeader
from ivfmc_ros.storage.repair import check_recording
from ivfmc_ros.storage.repair import repair_recording

PROFILE = '/ivfmc/profile'


def flip(path, offset):
    data = bytearray(path.read_bytes())
    data[offset] ^= 0x10
    path.write_bytes(data)


def chunk_middles(path):
    """Return an offset inside of the data of each chunk."""
    data, found = path.read_bytes(), []
    position = data.find(b'\x04\0\0\0zstd')
    while position >= 0:
        found.append(position + 40)
        position = data.find(b'\x04\0\0\0zstd', position + 1)
    # the index names the compression of each chunk once more
    return found[: len(found) // 2]


@pytest.fixture
def scan(tmp_path):
    """Folder of a finished recording: 12 profiles of 2 views, 3 in a chunk."""
    write_profiles(tmp_path / 's1', range(12), per_chunk=3)
    return tmp_path / 's1'


def test_sound_recording_is_left_as_it_is(scan):
    before = {path.name: path.read_bytes() for path in scan.iterdir()}
    repaired = repair_recording(scan)
    assert repaired.before.is_sound
    assert repaired.before.is_complete
    assert repaired.before.lines() == []
    assert repaired.written == ()
    assert {path.name: path.read_bytes() for path in scan.iterdir()} == before


def test_damaged_chunk_is_named_with_the_profiles_that_were_in_it(scan):
    flip(scan / 'scan.mcap', chunk_middles(scan / 'scan.mcap')[1])
    check = check_recording(scan)
    assert not check.is_sound
    assert check.messages == {PROFILE: 9}
    assert check.lost == {PROFILE: 3}
    [run] = check.missing
    assert (run.first_seq, run.last_seq, run.views) == (3, 5, (0, 1))
    assert (run.from_angle, run.to_angle) == (pytest.approx(0.2), pytest.approx(0.6))
    assert 'profiles 3 to 5 (view 0 or 1, table angle 11.46 deg to 34.38 deg)' in str(run)
    assert 'the CRC of a chunk is wrong' in ' '.join(check.lines())


def test_repair_keeps_all_intact_chunks_and_the_original(scan):
    original = (scan / 'scan.mcap').read_bytes()
    whole = messages_of(scan)
    flip(scan / 'scan.mcap', chunk_middles(scan / 'scan.mcap')[1])
    damaged = (scan / 'scan.mcap').read_bytes()
    assert damaged != original
    repaired = repair_recording(scan)
    assert messages_of(scan) == whole[:3] + whole[6:]
    assert (scan / 'scan.mcap.damaged').read_bytes() == damaged
    assert scan / 'scan.mcap.damaged' in repaired.kept
    after = check_recording(scan)
    assert after.is_sound
    assert not after.is_complete
    assert after.lost == {PROFILE: 3}
    assert repair_recording(scan).written == ()


@pytest.mark.parametrize('byte', range(4))
def test_wrong_length_of_an_index_loses_no_profile(scan, byte):
    """It leads behind the next chunks, where a record may begin by chance."""
    whole, file = messages_of(scan), scan / 'scan.mcap'
    # opcode and length of the index behind the first chunk: one entry of 16 bytes for each profile
    index = bytes([7]) + (2 + 4 + 3 * 16).to_bytes(8, 'little')
    content = file.read_bytes()
    place = content.index(index) + 1
    for bit in range(8):
        data = bytearray(content)
        data[place + byte] ^= 1 << bit
        file.write_bytes(data)
        assert messages_of(scan, salvage=True) == whole


def test_repaired_bag_is_read_by_other_software(scan):
    flip(scan / 'scan.mcap', chunk_middles(scan / 'scan.mcap')[0])
    repair_recording(scan)
    with Reader(scan) as reader:
        assert len(list(reader.messages())) == 9


def test_damage_says_what_the_catalogue_knows(scan):
    flip(scan / 'scan.mcap', chunk_middles(scan / 'scan.mcap')[-1])
    acknowledged = {
        seq: ProfileHeader(seq=seq, view=1, laser=0, angle=0.1 * seq, points=1, stamp_ns=0)
        for seq in range(12)
    }
    [run] = check_recording(scan, acknowledged, planned_views=3).missing
    assert (run.first_seq, run.last_seq, run.views) == (9, 11, (1,))
    assert run.to_angle == pytest.approx(1.1)
    assert check_recording(scan, acknowledged, planned_views=3).missing_views == (2,)


def test_interrupted_recording_becomes_a_bag(tmp_path):
    folder = tmp_path / 's1'
    write_profiles(folder, range(9), per_chunk=3, finish=False)
    part = folder / 'scan.mcap.part'
    part.write_bytes(part.read_bytes()[:-100])
    content = part.read_bytes()
    repaired = repair_recording(folder)
    assert folder / 'scan.mcap' in repaired.written
    assert part.read_bytes() == content
    assert len(messages_of(folder)) == 6
    assert check_recording(folder).is_sound


def test_running_recording_is_not_repaired(tmp_path):
    bag = BagWriter(tmp_path)
    bag.joint_state(START, 'turntable_joint', 0.0)
    bag.flush()
    with pytest.raises(FileError, match='is being recorded'):
        repair_recording(tmp_path)
    bag.close()
    assert repair_recording(tmp_path).written


@pytest.mark.parametrize('text', [None, 'rosbag2_bagfile_information: [', '{}'])
def test_metadata_is_rebuilt(scan, text):
    whole = messages_of(scan)
    if text is None:
        (scan / 'metadata.yaml').unlink()
    else:
        (scan / 'metadata.yaml').write_text(text)
    assert not check_recording(scan).is_sound
    assert repair_recording(scan).written == (scan / 'metadata.yaml',)
    assert check_recording(scan).is_sound
    assert messages_of(scan) == whole


def test_lying_metadata_is_named(scan):
    path = scan / 'metadata.yaml'
    path.write_text(path.read_text().replace('message_count: 12', 'message_count: 13'))
    assert (
        'states 13 messages of /ivfmc/profile, the files have 12' in check_recording(scan).metadata
    )


@pytest.mark.parametrize('seed', range(12))
def test_flipped_bit_is_repaired_or_harmless(scan, seed):
    path = scan / 'scan.mcap'
    whole = set(messages_of(scan))
    # the first bytes name the format
    flip(path, random.Random(seed).randrange(8, path.stat().st_size))
    lost = sum(check_recording(scan).lost.values())
    repair_recording(scan)
    left = messages_of(scan)
    assert set(left) <= whole
    assert len(left) == 12 - lost
    assert len(left) >= 9


@pytest.mark.parametrize('share', np.linspace(0.05, 0.999, 8))
def test_cut_recording_is_repaired(scan, share):
    path = scan / 'scan.mcap'
    whole = messages_of(scan)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    repair_recording(scan)
    left = messages_of(scan)
    assert left == whole[: len(left)]
    assert len(left) % 3 == 0


def test_split_bag_is_repaired_file_by_file(tmp_path):
    first, second = tmp_path / 'a', tmp_path / 'b'
    write_profiles(first, range(6), per_chunk=3)
    write_profiles(second, range(6, 12), per_chunk=3)
    shutil.move(first / 'scan.mcap', first / 'bag_0.mcap')
    shutil.move(second / 'scan.mcap', first / 'bag_1.mcap')
    (first / 'metadata.yaml').unlink()
    flip(first / 'bag_1.mcap', chunk_middles(first / 'bag_1.mcap')[0])
    repair_recording(first)
    assert len(messages_of(first)) == 9
    assert not (first / 'bag_0.mcap.damaged').exists()
    assert check_recording(first).is_sound


def test_folder_without_a_recording_is_named(tmp_path):
    with pytest.raises(BagError, match='is not a bag'):
        check_recording(tmp_path)


def test_sqlite_bag_is_verified_and_not_repaired(scan, tmp_path):
    file = write_sqlite(scan, tmp_path / 'theirs')
    check = check_recording(file.parent)
    assert (check.is_sound, check.is_complete, check.messages) == (True, True, {PROFILE: 12})
    assert sorted(check.files[0].profiles) == list(range(12))
    assert '12 messages outside of chunks have no CRC' in ' '.join(check.lines())
    data = file.read_bytes()
    file.write_bytes(data[:-5000])
    check = check_recording(file.parent)
    assert not check.is_sound
    assert 'is cut off' in ' '.join(check.lines())
    with pytest.raises(FileError, match=r'theirs\.db3: only MCAP is repaired; .*--salvage'):
        repair_recording(file.parent)


@pytest.fixture
def compressed(scan, tmp_path):
    """Folder of the same bag, its file compressed as a whole as by rosbag2."""
    folder = tmp_path / 'packed'
    folder.mkdir()
    packed = zstandard.ZstdCompressor().compress((scan / 'scan.mcap').read_bytes())
    (folder / 'bag_0.mcap.zstd').write_bytes(packed)
    text = (scan / 'metadata.yaml').read_text().replace('scan.mcap', 'bag_0.mcap.zstd')
    for key, value in (('compression_format', 'zstd'), ('compression_mode', 'FILE')):
        assert f"{key}: ''" in text
        text = text.replace(f"{key}: ''", f'{key}: {value}')
    (folder / 'metadata.yaml').write_text(text)
    return folder


def test_compressed_file_is_verified_and_a_sound_one_is_left(scan, compressed):
    before = {path.name: path.read_bytes() for path in compressed.iterdir()}
    check = check_recording(compressed)
    assert (check.is_sound, check.messages) == (True, {PROFILE: 12})
    assert sorted(check.files[0].profiles) == list(range(12))
    assert repair_recording(compressed).written == ()
    assert {path.name: path.read_bytes() for path in compressed.iterdir()} == before


def test_damaged_compressed_file_becomes_a_plain_one_and_is_kept(scan, compressed):
    [packed] = compressed.glob('*.mcap.zstd')
    whole = messages_of(compressed)
    file = scan / 'scan.mcap'
    content = file.read_bytes()[: chunk_middles(file)[2]]
    damaged = zstandard.ZstdCompressor().compress(content)
    packed.write_bytes(damaged)
    check = check_recording(compressed)
    assert not check.is_sound
    assert f'{packed}: ' in ' '.join(check.lines())
    assert 'ivfmc_' not in ' '.join(check.lines())
    repaired = repair_recording(compressed)
    plain = packed.with_suffix('')
    assert set(repaired.written) == {plain, compressed / 'metadata.yaml'}
    assert packed in repaired.kept
    assert packed.read_bytes() == damaged
    left = messages_of(compressed)
    assert left == whole[:6]
    with Reader(compressed) as reader:
        assert len(list(reader.messages())) == len(left)
    assert check_recording(compressed).is_sound


def test_repaired_messages_are_not_compressed_by_themselves(scan, tmp_path):
    target = tmp_path / 'packed'
    mode = CompressionMode.MESSAGE, CompressionFormat.ZSTD
    write_rosbag2(scan, target, storage=StoragePlugin.MCAP, compression=mode)
    [file] = target.glob('*.mcap')
    file.write_bytes(file.read_bytes()[:-40])
    repair_recording(target)
    assert messages_of(target) == messages_of(scan)
    with Reader(target) as reader:
        assert [data for _, _, data in reader.messages()] == [
            data for _, _, data in messages_of(scan)
        ]


def test_lying_metadata_of_a_sqlite_bag_is_named(scan, tmp_path):
    path = write_sqlite(scan, tmp_path / 'theirs').with_name('metadata.yaml')
    path.write_text(path.read_text().replace('message_count: 12', 'message_count: 13'))
    assert 'states 13 messages of /ivfmc/profile' in check_recording(path.parent).metadata


def test_ros1_bag_is_verified(scan, tmp_path):
    check = check_recording(write_ros1(scan, tmp_path / 'theirs.bag'))
    assert (check.is_sound, check.messages) == (True, {PROFILE: 12})
    assert sorted(check.files[0].profiles) == list(range(12))
