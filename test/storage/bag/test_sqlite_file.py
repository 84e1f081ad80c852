# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""SQLite bags of rosbag2: read as the MCAP bag of the same messages, or refused by name."""

from contextlib import closing
import random
import sqlite3
import tracemalloc

import numpy as np
import pytest
from support.foreign_bags import split_sqlite
from support.foreign_bags import write_sqlite
from support.recordings import messages_of

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.bag.reader import open_bag
from ivfmc_ros.storage.scans.scan_bag import open_scan

IMAGE = '/ivfmc/image_raw'
PAGE = 4096


@pytest.fixture
def theirs(ours, tmp_path):
    """The .db3 file of a bag folder with the messages of ``ours``."""
    return write_sqlite(ours, tmp_path / 'theirs')


@pytest.mark.parametrize('definitions', [True, False])
@pytest.mark.parametrize('form', ['folder', 'file'])
def test_sqlite_bag_is_the_mcap_bag_of_its_messages(ours, tmp_path, form, definitions):
    file = write_sqlite(ours, tmp_path / 'theirs', definitions=definitions)
    path = file if form == 'file' else file.parent
    assert messages_of(path) == messages_of(ours)
    bag = open_bag(path)
    assert bag.remarks == ()
    assert bool(bag.topic(IMAGE).definition) is definitions
    for frame, expected in zip(open_scan(path).frames(), open_scan(ours).frames(), strict=True):
        assert (frame.stamp_ns, frame.angle) == (expected.stamp_ns, expected.angle)
        np.testing.assert_array_equal(frame.image, expected.image)


@pytest.mark.parametrize('listed', [True, False])
def test_files_of_a_split_recording_are_one_bag(ours, tmp_path, listed):
    folder = split_sqlite(ours, tmp_path / 'theirs', at=7)
    if not listed:
        (folder / 'metadata.yaml').unlink()
    assert messages_of(folder) == messages_of(ours)
    said = f'{folder}: has no metadata.yaml; theirs_0.db3, theirs_1.db3 is read without it'
    assert open_bag(folder).remarks == (() if listed else (said,))


def test_file_that_is_cut_off_is_refused_and_salvaged(ours, theirs):
    # no multiple of the size of a page: SQLite would fill the last one with zeros
    theirs.write_bytes(theirs.read_bytes()[: theirs.stat().st_size * 3 // 4 + 500])
    with pytest.raises(BagError, match=r'theirs\.db3: the file is cut off; (\d+) messages can'):
        open_bag(theirs)
    left, whole = messages_of(theirs, salvage=True), messages_of(ours)
    assert 0 < len(left) < len(whole)
    assert left == whole[: len(left)]


def test_file_cut_anywhere_is_never_read_as_whole(ours, theirs):
    content, whole = theirs.read_bytes(), messages_of(ours)
    for keep in range(16, len(content), 1021):
        theirs.write_bytes(content[:keep])
        with pytest.raises(BagError, match=r'theirs\.db3: '):
            open_bag(theirs)
        try:
            assert set(messages_of(theirs, salvage=True)) <= set(whole)
        except BagError as error:
            # tables are lost
            assert 'its topics cannot be read' in str(error)


def test_flipped_bits_end_in_a_named_error_or_in_messages(theirs):
    content, rng = theirs.read_bytes(), random.Random(5)
    found = 0
    for _ in range(150):
        data = bytearray(content)
        # in the header of a page, or anywhere
        start = rng.randrange(1, len(data) // PAGE) * PAGE
        where = rng.choice([start + rng.randrange(12), rng.randrange(16, len(data))])
        data[where] ^= 1 << rng.randrange(8)
        theirs.write_bytes(data)
        for salvage in (False, True):
            try:
                messages_of(theirs, salvage=salvage)
            except BagError as error:
                assert str(theirs) in str(error)
                found += 1
    assert found


def test_messages_behind_the_damage_are_salvaged(ours, theirs):
    whole = messages_of(ours)
    images = [message for message in whole if message[0] == IMAGE]
    content = bytearray(theirs.read_bytes())
    # the page that holds the end of the third image
    start = content.index(images[2][2][-500:]) // PAGE * PAGE
    content[start : start + 4] = b'\xff\xff\xff\xff'
    theirs.write_bytes(content)
    with pytest.raises(BagError, match=r'theirs\.db3: the file is damaged .*; (\d+) messages'):
        messages_of(theirs)
    left = messages_of(theirs, salvage=True)
    assert images[2] not in left
    assert len(whole) - 8 < len(left) < len(whole)
    assert [message for message in whole if message in left] == left
    assert (left[0], left[-1]) == (whole[0], whole[-1])


def test_file_that_another_program_locks_is_named(theirs):
    with closing(sqlite3.connect(theirs, isolation_level=None)) as recorder:
        recorder.execute('BEGIN EXCLUSIVE')
        with pytest.raises(BagError, match=r'theirs\.db3: is locked by another program; stop'):
            open_bag(theirs)


def test_messages_in_the_log_of_a_running_recorder_are_read(ours, theirs):
    with closing(sqlite3.connect(theirs, isolation_level=None)) as recorder:
        recorder.execute('PRAGMA journal_mode=WAL')
        columns = 'topic_id, timestamp, data'
        recorder.execute(
            f'INSERT INTO messages ({columns}) SELECT {columns} FROM messages WHERE id = 1'
        )
        assert (theirs.parent / 'theirs.db3-wal').stat().st_size
        assert messages_of(theirs) == [*messages_of(ours), messages_of(ours)[0]]


def test_reading_leaves_no_trace(theirs):
    with closing(sqlite3.connect(theirs, isolation_level=None)) as recorder:
        recorder.execute('PRAGMA journal_mode=WAL')
    before = {path.name: path.read_bytes() for path in theirs.parent.iterdir()}
    messages_of(theirs)
    assert {path.name: path.read_bytes() for path in theirs.parent.iterdir()} == before


def test_other_serialization_is_refused_by_name(ours, tmp_path):
    file = write_sqlite(ours, tmp_path / 'theirs', encoding='protobuf')
    with pytest.raises(BagError, match=r"theirs\.db3: the messages are encoded as 'protobuf'"):
        open_bag(file)


def test_other_database_is_named(tmp_path):
    with closing(sqlite3.connect(tmp_path / 'x.db3')) as database:
        database.execute('CREATE TABLE topics (id INTEGER)')
    with pytest.raises(BagError, match=r'x\.db3: is an SQLite file, but not a bag: it has no tab'):
        open_bag(tmp_path / 'x.db3')


@pytest.mark.parametrize(
    ('change', 'problem'),
    [
        ('UPDATE messages SET topic_id = 9 WHERE id > 4', 'messages are of topics that it does'),
        ('UPDATE messages SET data = NULL WHERE id = 5', 'row of message 5 is not that of a mes'),
        ('UPDATE messages SET timestamp = "x" WHERE id = 5', 'row of message 5 is not that of a'),
    ],
)
def test_row_that_is_no_message_is_named(theirs, change, problem):
    with closing(sqlite3.connect(theirs)) as database:
        text = database.execute('SELECT sql FROM sqlite_master WHERE name = "messages"')
        plain = text.fetchone()[0].replace('data BLOB NOT NULL', 'data BLOB')
        database.execute('PRAGMA writable_schema=ON')
        database.execute('UPDATE sqlite_master SET sql = ? WHERE name = "messages"', (plain,))
        database.commit()
    with closing(sqlite3.connect(theirs)) as database:
        database.execute(change)
        database.commit()
    with pytest.raises(BagError, match=problem):
        messages_of(theirs)
    assert len(messages_of(theirs, salvage=True)) >= 4


def test_memory_does_not_grow_with_the_file(tmp_path):
    file = tmp_path / 'large.db3'
    with closing(sqlite3.connect(file)) as database:
        database.execute('CREATE TABLE topics(id INTEGER, name, type, serialization_format)')
        database.execute('INSERT INTO topics VALUES(1, "/x", "std_msgs/msg/String", "cdr")')
        database.execute(
            'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data)'
        )
        database.executemany(
            'INSERT INTO messages VALUES(?, 1, ?, zeroblob(1000000))', [(k, k) for k in range(60)]
        )
        database.commit()
    bag = open_bag(file)
    tracemalloc.start()
    try:
        assert sum(len(raw.data) for raw in bag.messages(['/x'])) == 60_000_000
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 5_000_000
