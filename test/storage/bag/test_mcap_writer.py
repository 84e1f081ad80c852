# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import io

from mcap.reader import make_reader
from mcap.records import DataEnd
from mcap.stream_reader import StreamReader
import pytest

from ivfmc_ros.storage.bag.mcap_writer import McapWriter


@pytest.fixture(params=[True, False], ids=['zstd', 'raw'])
def stream(request):
    """File of two topics in two chunks, times not in order."""
    stream = io.BytesIO()
    writer = McapWriter(stream, compress=request.param)
    schema = writer.add_schema('std_msgs/msg/Empty', b'')
    a = writer.add_channel('/a', 'cdr', schema, {'k': 'v'})
    writer.add_message(a, 20, b'first' * 100, 0)
    writer.flush()
    b = writer.add_channel('/b', 'cdr', schema, {})
    writer.add_message(b, 10, b'second', 0)
    writer.add_message(a, 30, b'third', 1)
    writer.add_metadata('rosbag2', {'x': 'y'})
    writer.finish()
    stream.seek(0)
    return stream


def test_index_leads_to_every_message(stream):
    reader = make_reader(stream, validate_crcs=True)
    found = [(c.topic, m.log_time, m.sequence) for _, c, m in reader.iter_messages()]
    assert found == [('/b', 10, 0), ('/a', 20, 0), ('/a', 30, 1)]
    only = [m.data for _, _, m in reader.iter_messages(topics=['/a'], start_time=25)]
    assert only == [b'third']
    assert [(m.name, m.metadata) for m in reader.iter_metadata()] == [('rosbag2', {'x': 'y'})]


def test_summary_counts(stream):
    statistics = make_reader(stream).get_summary().statistics
    assert (statistics.message_count, statistics.chunk_count) == (3, 2)
    assert (statistics.message_start_time, statistics.message_end_time) == (10, 30)
    assert statistics.channel_message_counts == {1: 2, 2: 1}


def test_checksum_of_the_data_is_that_of_its_bytes(stream):
    records = list(StreamReader(stream, validate_crcs=True).records)
    (end,) = [record for record in records if isinstance(record, DataEnd)]
    assert end.data_section_crc != 0


def test_flush_without_messages_writes_no_chunk():
    stream = io.BytesIO()
    writer = McapWriter(stream)
    before = stream.tell()
    assert writer.flush() == before == stream.tell()
