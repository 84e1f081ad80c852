# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Reads one ROS 1 bag file (.bag, version 2.0): its topics, and its messages converted to CDR.

rosbags reads the file by its index and converts the messages by the definitions in it. A file
whose index is missing or damaged is refused; of one with other damage, what precedes it can be
salvaged.
"""

from collections import Counter
from collections.abc import Callable
from collections.abc import Collection
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
import re
import struct
from typing import Any

from rosbags.rosbag1 import Reader
from rosbags.rosbag1 import ReaderError
from rosbags.serde import SerdeError
from rosbags.typesys import get_types_from_msg
from rosbags.typesys import get_typestore
from rosbags.typesys import Stores
from rosbags.typesys import TypesysError

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.bag.bag_file import FileContents
from ivfmc_ros.storage.bag.bag_file import FileDamage
from ivfmc_ros.storage.bag.bag_file import Topic
from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.storage.messages.sensor_messages import CAMERA_INFO
from ivfmc_ros.storage.messages.sensor_messages import TF_MESSAGE

MAGIC = b'#ROSBAG V'

# Types of ROS 1 that have another name in ROS 2, and the same fields.
_RENAMED = {'tf/msg/tfMessage': TF_MESSAGE}
# Field of the header that ROS 2 does not have, and the matrices that it has in lower case.
_COUNTER = 'seq'
_MATRIX = re.compile(r'^(float64\[\d*\]) ([DKRP])$', re.MULTILINE)

# What rosbags and the decompressors raise for damaged files.
_ERRORS = (
    ReaderError,
    SerdeError,
    TypesysError,
    struct.error,
    AssertionError,
    EOFError,
    IndexError,
    KeyError,
    MemoryError,
    OSError,
    RuntimeError,
    ValueError,
)
_ADVICE = 'run rosbag reindex on it, or copy the file again'


def read_contents(file: Path, *, use_index: bool) -> FileContents:
    """Return the topics of a file, as ``BagFormat`` says."""
    with _opened(file) as reader:
        topics = [_topic(connection) for connection in reader.connections]
    if use_index:
        return FileContents(topics=topics)
    counts: Counter[str] = Counter()
    fault = ''
    try:
        counts.update(topic for topic, _, _ in read_messages(file, None, salvage=False))
    except FileDamage as damage:
        fault = str(damage)
        counts = Counter(topic for topic, _, _ in read_messages(file, None, salvage=True))
    # a topic of several publishers is there more than once, and its count is that of all of them
    unique = {topic.name: topic for topic in topics}
    found = [Topic(**{**vars(topic), 'count': counts[name]}) for name, topic in unique.items()]
    return FileContents(topics=found, fault=fault)


def read_messages(
    file: Path,
    topics: Collection[str] | None,
    *,
    salvage: bool,
    validate_crcs: bool = True,
) -> Iterator[tuple[str, int, bytes]]:
    """
    Yield messages in the order of their times, as ``BagFormat`` says.

    salvage : end at the first damage
    """
    with _opened(file) as reader:
        wanted = [one for one in reader.connections if topics is None or one.topic in topics]
        converters = {one.id: _converter(one) for one in wanted}
        # without a connection rosbags reads all of them
        source = reader.messages(wanted) if wanted else iter(())
        while True:
            try:
                found = next(source, None)
                data = converters[found[0].id](found[2]) if found else b''
            except _ERRORS as error:
                if salvage:
                    return
                raise FileDamage(f'is damaged ({error or type(error).__name__})') from error
            if found is None:
                return
            yield found[0].topic, found[1], data


@contextmanager
def _opened(file: Path) -> Iterator[Reader]:
    """:raises BagError: the file is damaged or has no index."""
    reader = Reader(file)
    try:
        reader.open()
    except _ERRORS as error:
        reason = str(error) or type(error).__name__
        raise BagError(f'{file}: cannot be read as a ROS 1 bag ({reason}); {_ADVICE}') from error
    try:
        yield reader
    finally:
        reader.close()


def _topic(connection: Any) -> Topic:
    name = _RENAMED.get(connection.msgtype, connection.msgtype)
    try:
        definition = _definition(connection)
        _converter(connection)
    except _ERRORS:
        # a type that rosbags does not understand; it matters only where the topic is needed
        return _described(connection, name, 'ros1', '')
    return _described(connection, name, cdr.ENCODING, definition)


def _described(connection: Any, name: str, encoding: str, definition: str) -> Topic:
    return Topic(
        name=connection.topic,
        msgtype=name,
        encoding=encoding,
        count=connection.msgcount,
        schema_encoding='ros2msg',
        definition=definition,
    )


def _store(connection: Any) -> Any:
    types = dict(get_types_from_msg(connection.msgdef.data, connection.msgtype))
    if cdr.HEADER in types:
        # rosbags leaves the counter out by itself, if it is not a field
        constants, fields = types[cdr.HEADER]
        types[cdr.HEADER] = constants, [field for field in fields if field[0] != _COUNTER]
    store = get_typestore(Stores.EMPTY)
    store.register(types)
    return store


def _definition(connection: Any) -> str:
    """Return the definition of the converted messages, in the format ros2msg."""
    text, _ = _store(connection).generate_msgdef(connection.msgtype, ros_version=2)
    if connection.msgtype == CAMERA_INFO:
        text = _MATRIX.sub(lambda found: f'{found[1]} {found[2].lower()}', text)
    return str(text)


def _converter(connection: Any) -> Callable[[bytes], bytes]:
    """Return the function that converts the messages of a connection to CDR."""
    store = _store(connection)
    # compiles the definition, which may fail
    store.get_msgdef(connection.msgtype)
    return lambda data: bytes(store.ros1_to_cdr(data, connection.msgtype))
