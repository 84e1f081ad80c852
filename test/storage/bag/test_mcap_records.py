# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import random
import struct
import zlib

from mcap.data_stream import RecordBuilder
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel
from mcap.records import Chunk
from mcap.records import Message
from mcap.records import Schema
from mcap.stream_reader import breakup_chunk
from mcap.stream_reader import StreamReader
import pytest

from ivfmc_ros.storage.bag.mcap_records import chunk_records
from ivfmc_ros.storage.bag.mcap_records import file_records
from ivfmc_ros.storage.bag.mcap_writer import McapWriter
from ivfmc_ros.storage.bag.summary import READ_ERRORS

_MESSAGE_RECORD = 5
_SCHEMA = Schema(id=1, name='std_msgs/msg/String', encoding='ros2msg', data=b'string data')
_CHANNEL = Channel(id=7, topic='/a', message_encoding='cdr', metadata={}, schema_id=1)


def _message(data):
    return Message(
        channel_id=7, log_time=30, publish_time=20, sequence=3, data=data
    )  # fmt: skip


def _content(records):
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()


def _chunk(content, crc=None):
    return Chunk(
        compression='',
        data=content,
        message_start_time=0,
        message_end_time=0,
        uncompressed_crc=zlib.crc32(content) if crc is None else crc,
        uncompressed_size=len(content),
    )


def test_yields_schemas_channels_and_messages_in_order():
    chunk = _chunk(_content([_SCHEMA, _CHANNEL, _message(b'abc'), _message(b'')]))
    found = list(chunk_records(chunk, validate_crc=True))
    assert found == [_SCHEMA, _CHANNEL, (7, 30, b'abc'), (7, 30, b'')]


def test_passes_over_records_of_other_programs():
    private = struct.pack('<BQ', 0x90, 3) + b'xyz'
    chunk = _chunk(private + _content([_message(b'abc')]))
    assert list(chunk_records(chunk, validate_crc=True)) == [(7, 30, b'abc')]


def test_only_a_message_that_fills_its_chunk_is_a_view_of_it():
    # what is decoded from a view keeps the chunk in memory
    picture, state = b'p' * 1000, b's' * 100
    chunk = _chunk(_content([_message(state), _message(picture)]))
    found = [data for _, _, data in chunk_records(chunk, validate_crc=True)]
    assert found == [state, picture]
    assert isinstance(found[0], bytes)
    assert isinstance(found[1], memoryview)
    assert found[1].obj is chunk.data


def test_refuses_a_wrong_crc_unless_it_was_validated_before():
    chunk = _chunk(_content([_message(b'abc')]), crc=1)
    with pytest.raises(ValueError, match='CRC of a chunk'):
        list(chunk_records(chunk, validate_crc=True))
    assert list(chunk_records(chunk, validate_crc=False)) == [(7, 30, b'abc')]


@pytest.mark.parametrize('cut', [1, 4, 8])
def test_refuses_a_record_that_is_longer_than_its_chunk(cut):
    content = _content([_message(b'abc'), _message(b'a longer one')])
    found = chunk_records(_chunk(content[:-cut]), validate_crc=True)
    assert next(found) == (7, 30, b'abc')
    with pytest.raises(ValueError, match='longer than its chunk'):
        next(found)


def test_refuses_a_chunk_that_ends_inside_the_head_of_a_record():
    content = _content([_message(b'abc')])
    found = chunk_records(_chunk(content + content[:5]), validate_crc=True)
    assert next(found) == (7, 30, b'abc')
    with pytest.raises(ValueError, match='inside a record'):
        next(found)


def test_refuses_a_message_that_is_shorter_than_its_own_head():
    record = struct.pack('<BQ', _MESSAGE_RECORD, 4) + b'\0' * 4
    with pytest.raises(struct.error):
        list(chunk_records(_chunk(record), validate_crc=True))


def test_reads_the_same_as_the_library():
    chunk = _chunk(_content([_SCHEMA, _CHANNEL, *(_message(bytes([n]) * n) for n in range(99))]))
    expected = [
        (record.channel_id, record.log_time, record.data)
        if isinstance(record, Message)
        else record
        for record in breakup_chunk(chunk, validate_crc=True)
    ]
    assert list(chunk_records(chunk, validate_crc=True)) == expected


@pytest.mark.parametrize('compress', [True, False])
def test_file_is_read_as_by_the_library(tmp_path, compress):
    file = _written(tmp_path, compress)
    with file.open('rb') as stream:
        expected = [
            (record.channel_id, record.log_time, record.data)
            if isinstance(record, Message)
            else record
            for record in StreamReader(stream, validate_crcs=True).records
            if isinstance(record, Message | Schema | Channel)
        ]
    found = list(file_records(file, validate_crcs=True))
    # the index repeats schemas and channels
    assert found == expected[: len(found)]
    assert sum(isinstance(record, tuple) for record in found) == 60


@pytest.mark.parametrize('compress', [True, False])
def test_every_flipped_bit_of_the_data_section_is_found(tmp_path, compress):
    file = _written(tmp_path, compress)
    good = file.read_bytes()
    end = good.index(struct.pack('<BQ', Opcode.DATA_END, 4))
    rng = random.Random(0)
    for _ in range(200):
        damaged = bytearray(good)
        damaged[rng.randrange(end)] ^= 1 << rng.randrange(8)
        file.write_bytes(damaged)
        with pytest.raises(READ_ERRORS):
            list(file_records(file, validate_crcs=True))


def test_a_length_beyond_the_end_needs_no_memory(tmp_path):
    file = _written(tmp_path, False)
    damaged = bytearray(file.read_bytes())
    struct.pack_into('<Q', damaged, 9, 1 << 60)
    file.write_bytes(damaged)
    with pytest.raises(EndOfFile):
        list(file_records(file, validate_crcs=True))


def _written(folder, compress):
    file = folder / 'a.mcap'
    with file.open('wb') as stream:
        writer = McapWriter(stream, compress=compress)
        schema = writer.add_schema('std_msgs/msg/String', b'string data')
        channel = writer.add_channel('/a', 'cdr', schema, {})
        for number in range(60):
            writer.add_message(channel, number, bytes([number]) * (number * number), number)
            if number % 7 == 0:
                writer.flush()
        writer.finish()
    return file
