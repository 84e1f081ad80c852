# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
from pathlib import Path
import random

from mcap.writer import CompressionType
from mcap.writer import IndexType
import pytest

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.bag.bag_file import Topic
from ivfmc_ros.storage.bag.reader import Bag
from ivfmc_ros.storage.bag.reader import open_bag
from ivfmc_ros.storage.messages import sensor_messages

JOINT = sensor_messages.JOINT_STATE


def _joints(count):
    return [sensor_messages.joint_state(index, {'turntable_joint': 0.1}) for index in range(count)]


def _cut(path, keep):
    target = path.with_name('cut.mcap')
    target.write_bytes(path.read_bytes()[:keep])
    return target


def _flip(path, where):
    data = bytearray(path.read_bytes())
    data[where] ^= 0x20
    target = path.with_name('flipped.mcap')
    target.write_bytes(data)
    return target


@pytest.mark.parametrize('form', ['folder', 'file'])
def test_folder_and_file_are_the_same_bag(write_bag, form):
    folder = write_bag(count=3)
    bag = open_bag(folder if form == 'folder' else folder / 'scan.mcap')
    assert {name: topic.count for name, topic in bag.topics.items()} == {
        '/ivfmc/joint_states': 3,
        '/ivfmc/camera_info': 3,
        '/ivfmc/image_raw': 3,
    }
    assert bag.topic('/ivfmc/image_raw').msgtype == 'sensor_msgs/msg/Image'
    assert [raw.index for raw in bag.messages(['/ivfmc/image_raw'])] == [0, 1, 2]


@pytest.mark.parametrize(
    'options',
    [
        {'index_types': IndexType.NONE, 'use_statistics': False},
        {'repeat_channels': False, 'repeat_schemas': False, 'use_statistics': False,
         'index_types': IndexType.NONE, 'use_summary_offsets': False},
        {'use_chunking': False},
        {'enable_crcs': False},
        {'compression': CompressionType.LZ4},
        {'compression': CompressionType.NONE},
    ],
)  # fmt: skip
def test_file_of_another_writer_is_read(write_mcap, options):
    bag = open_bag(write_mcap(('/joint_states', JOINT, _joints(4)), **options))
    assert bag.topics['/joint_states'].count == 4
    decode = bag.decoder('/joint_states')
    assert [decode(raw).name for raw in bag.messages(['/joint_states'])] == (
        [['turntable_joint']] * 4
    )


def test_split_bag_is_one(write_bag, tmp_path):
    first, second = write_bag('a', count=2), write_bag('b', count=3)
    (second / 'scan.mcap').rename(first / 'more.mcap')
    text = (first / 'metadata.yaml').read_text()
    listed = text.replace('  - scan.mcap', '  - scan.mcap\n  - more.mcap')
    (first / 'metadata.yaml').write_text(listed)
    bag = open_bag(first)
    assert bag.topics['/ivfmc/image_raw'].count == 5
    assert [raw.index for raw in bag.messages(['/ivfmc/image_raw'])] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize('content', [b'', b'hello', b'SQLite format 3\0' + b'\0' * 100])
def test_file_that_is_not_mcap_is_named(tmp_path, content):
    (tmp_path / 'x.mcap').write_bytes(content)
    with pytest.raises(BagError, match=r'x\.mcap: '):
        open_bag(tmp_path / 'x.mcap')


def test_missing_file_is_named(tmp_path, write_bag):
    with pytest.raises(BagError, match=r'none\.mcap: cannot be read: No such file'):
        open_bag(tmp_path / 'none.mcap')
    folder = write_bag()
    (folder / 'scan.mcap').unlink()
    with pytest.raises(BagError, match=r'bag/scan\.mcap: cannot be read: No such file'):
        open_bag(folder)


def test_truncated_file_is_refused_with_the_readable_counts(write_mcap):
    whole = write_mcap(('/joint_states', JOINT, _joints(400)), chunk_size=4000)
    cut = _cut(whole, whole.stat().st_size // 2)
    with pytest.raises(
        BagError, match=r'cut\.mcap: the file is cut off; (\d+) messages'
    ) as caught:
        open_bag(cut)
    bag = open_bag(cut, salvage=True)
    assert 0 < bag.message_count < 400
    assert f'({bag.message_count} on /joint_states)' in str(caught.value)
    assert str(caught.value).startswith(bag.damage)
    assert bag.remarks == (bag.damage,)
    assert '--salvage' in str(caught.value)
    assert len(list(bag.messages(['/joint_states']))) == bag.message_count


def test_file_cut_anywhere_is_refused(write_mcap):
    whole = write_mcap(('/joint_states', JOINT, _joints(20)), chunk_size=500)
    complete = whole.read_bytes().rindex(b'\x0f\x04\0\0\0\0\0\0\0') + 13
    for keep in range(8, complete, 97):
        with pytest.raises(BagError, match='cut off'):
            open_bag(_cut(whole, keep))
        open_bag(_cut(whole, keep), salvage=True)
    # what follows is the index, without which all messages can be read
    for keep in range(complete, whole.stat().st_size, 97):
        bag = open_bag(_cut(whole, keep))
        assert len(list(bag.messages(['/joint_states']))) == 20
        assert 'the index at the end of the file is damaged' in bag.remarks[0]


def test_flipped_bit_in_a_chunk_is_found(write_mcap):
    path = write_mcap(('/joint_states', JOINT, _joints(400)), chunk_size=4000)
    flipped = _flip(path, path.read_bytes().find(b'zstd', path.stat().st_size // 3) + 200)
    bag = open_bag(flipped)
    with pytest.raises(BagError, match=r'flipped\.mcap: the file is damaged .*messages can be'):
        list(bag.messages(['/joint_states']))
    salvaged = open_bag(flipped, salvage=True)
    assert 0 < len(list(salvaged.messages(['/joint_states']))) < 400
    assert 'is damaged' in salvaged.damage


@pytest.mark.parametrize('seed', range(20))
def test_flipped_bit_anywhere_before_the_index_of_our_bags_is_found(write_bag, seed):
    path = write_bag() / 'scan.mcap'
    content = path.read_bytes()
    where = random.Random(seed).randrange(30, content.index(b'rosbag2'))
    with pytest.raises(BagError):
        list(open_bag(_flip(path, where)).messages(['/ivfmc/image_raw']))


def test_missing_topic_is_named_with_those_there_are(write_bag):
    with pytest.raises(BagError, match=r'no topic /tf; it has /ivfmc/camera_info \(sensor_msgs'):
        open_bag(write_bag()).decoder('/tf')


def test_unknown_encoding_of_all_is_refused_by_name(write_mcap):
    path = write_mcap(('/a', JOINT, [b'x']), encoding='json')
    with pytest.raises(BagError, match=r"encoded as 'json' \(/a\), only cdr can be read"):
        open_bag(path)


@pytest.mark.parametrize(
    ('changes', 'problem'),
    [
        ({'encoding': 'json'}, "/odd: is encoded as 'json', only cdr can be read"),
        ({'definition': '???'}, '/odd: the definition of mine/msg/Odd cannot be parsed'),
        ({'schema_encoding': 'protobuf'}, "its encoding is 'protobuf', known are ros2msg"),
    ],
)
def test_topic_that_cannot_be_decoded_is_named(changes, problem):
    fields = {'encoding': 'cdr', 'schema_encoding': 'ros2msg', 'definition': 'uint8 x\n'}
    topic = Topic(name='/odd', msgtype='mine/msg/Odd', count=1, **{**fields, **changes})
    bag = Bag(path=Path('b.mcap'), files=(), topics={'/odd': topic})
    with pytest.raises(BagError, match=r'^b\.mcap: /odd: .*') as caught:
        bag.decoder('/odd')
    assert problem in str(caught.value)


def test_missing_schema_is_named(write_mcap):
    path = write_mcap(('/a', JOINT, _joints(1)), ('/b', None, [b'\0\1\0\0']))
    with pytest.raises(BagError, match='/b: the bag has no message definition'):
        open_bag(path).decoder('/b')


def test_empty_definition_of_a_known_type_is_that_of_jazzy(write_mcap):
    bag = open_bag(write_mcap(('/a', JOINT, _joints(2))))
    empty = replace(bag.topics['/a'], definition='', schema_encoding='')
    decode = replace(bag, topics={'/a': empty}).decoder('/a')
    assert [list(decode(raw).name) for raw in bag.messages(['/a'])] == [['turntable_joint']] * 2
    unknown = replace(empty, msgtype='mine/msg/Odd')
    with pytest.raises(BagError, match='/a: the bag has no message definition'):
        replace(bag, topics={'/a': unknown}).decoder('/a')


def test_message_that_does_not_fit_is_named(write_mcap):
    path = write_mcap(('/a', JOINT, [*_joints(2), b'\0\1\0\0\1']))
    bag = open_bag(path)
    decode = bag.decoder('/a')
    with pytest.raises(BagError, match=r'foreign\.mcap: /a, message 2: 5 bytes are not a '):
        [decode(raw) for raw in bag.messages(['/a'])]


@pytest.mark.parametrize(
    ('name', 'counts'),
    [
        ('base_msgs', {'/one_shot/twist': 1, '/one_shot/vector3': 1, '/one_shot/string': 1}),
        ('cdr_test', {'/test_topic': 3, '/array_topic': 4}),
        ('talker', {'/rosout': 10, '/parameter_events': 0, '/topic': 10}),
        (
            'service_events',
            {
                '/test_topic1': 1,
                '/test_topic2': 1,
                '/test_service1/_service_event': 4,
                '/test_service2/_service_event': 4,
                '/events/write_split': 0,
            },
        ),
    ],
)
def test_bags_of_other_recorders_are_read(data_dir, name, counts):
    bag = open_bag(data_dir / 'bags' / f'{name}.mcap')
    assert {name: topic.count for name, topic in bag.topics.items()} == counts
    decoders = {topic: bag.decoder(topic) for topic in counts}
    decoded = [decoders[raw.topic](raw) for raw in bag.messages(counts)]
    assert len(decoded) == sum(counts.values())


def test_decoded_messages_of_other_recorders_have_their_content(data_dir):
    bag = open_bag(data_dir / 'bags' / 'talker.mcap')
    decode = bag.decoder('/topic')
    texts = [decode(raw).data for raw in bag.messages(['/topic'])]
    assert texts == [f'Hello, world! {index}' for index in range(10)]


def test_wrong_rmw_is_refused_by_name(data_dir):
    with pytest.raises(BagError, match=r"wrong_rmw\.mcap: .*encoded as 'wrong_format'"):
        open_bag(data_dir / 'bags' / 'wrong_rmw.mcap')


def test_file_that_is_renamed_while_it_is_opened_is_named(write_bag, monkeypatch):
    folder = write_bag(count=2)

    def vanish(file, **_):
        file.rename(file.with_suffix('.gone'))
        return file.stat()

    monkeypatch.setattr('ivfmc_ros.storage.bag.mcap_file.read_contents', vanish)
    with pytest.raises(BagError, match=r'scan\.mcap: cannot be read: No such file'):
        open_bag(folder)
