# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of other formats with the messages of one of ours, written by rosbags."""

from contextlib import closing
import sqlite3

from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer
from rosbags.typesys import get_types_from_msg
from rosbags.typesys import get_typestore
from rosbags.typesys import Stores
import yaml

from ivfmc_ros.storage.bag.reader import open_bag
from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.storage.messages.sensor_messages import TF_MESSAGE

# What a recorder before ROS 2 Iron does not write.
NEW_TABLES = ('message_definitions', 'schema', 'metadata')


def write_sqlite(source, target, *, encoding='cdr', definitions=True, skip=0, stop=None):
    """
    Write the messages of a bag into a new one of SQLite and return its .db3 file.

    definitions : with message definitions, as from ROS 2 Iron on
    skip, stop : range of the messages
    """
    bag = open_bag(source)
    with Writer(target, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connections = {
            name: writer.add_connection(
                name,
                topic.msgtype,
                msgdef=topic.definition,
                rihs01=cdr.type_hash(topic.msgtype),
                serialization_format=encoding,
            )
            for name, topic in bag.topics.items()
        }
        for raw in list(bag.messages(list(bag.topics)))[skip:stop]:
            writer.write(connections[raw.topic], raw.log_time_ns, raw.data)
    file = target / f'{target.name}.db3'
    if not definitions:
        with closing(sqlite3.connect(file)) as database:
            for table in NEW_TABLES:
                database.execute(f'DROP TABLE {table}')
            database.execute('VACUUM')
    return file


def write_rosbag2(source, target, *, storage, compression=None, cut=0):
    """
    Write the messages of a bag into a new one.

    compression : mode and format of rosbag2
    cut : bytes that each compressed message is short of
    """
    bag = open_bag(source)
    writer = Writer(target, version=9, storage_plugin=storage)
    if compression:
        writer.set_compression(*compression)
    with writer:
        if cut:
            write = writer.storage.write
            writer.storage.write = lambda connection, time_ns, data: write(
                connection, time_ns, data[:-cut]
            )
        for name, topic in bag.topics.items():
            connection = writer.add_connection(
                name, topic.msgtype, msgdef=topic.definition, rihs01=cdr.type_hash(topic.msgtype)
            )
            for raw in bag.messages([name]):
                writer.write(connection, raw.log_time_ns, raw.data)


def split_sqlite(source, target, at):
    """Write the messages of a bag into a new one of two SQLite files, split at a message."""
    first = write_sqlite(source, target, stop=at)
    first = first.rename(target / f'{target.name}_0.db3')
    rest = write_sqlite(source, target.with_name('rest'), skip=at)
    second = rest.rename(target / f'{target.name}_1.db3')
    document = yaml.safe_load((target / 'metadata.yaml').read_text())
    info = document['rosbag2_bagfile_information']
    info['relative_file_paths'] = [first.name, second.name]
    info['message_count'] = open_bag(source).message_count
    for entry in info['topics_with_message_count']:
        topic = open_bag(source).topics[entry['topic_metadata']['name']]
        entry['message_count'] = topic.count
    (target / 'metadata.yaml').write_text(yaml.safe_dump(document))
    return target


def write_ros1(source, target, *, compression=None, transforms=TF_MESSAGE):
    """
    Write the messages of a bag into a ROS 1 bag file and return it.

    compression : None, 'bz2' or 'lz4'
    transforms : type of ROS 1 for those of tf2_msgs/TFMessage
    """
    bag = open_bag(source)
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg('geometry_msgs/TransformStamped[] transforms', transforms))
    types = {
        name: transforms if topic.msgtype == TF_MESSAGE else topic.msgtype
        for name, topic in bag.topics.items()
    }
    writer = Ros1Writer(target)
    if compression:
        writer.set_compression(Ros1Writer.CompressionFormat[compression.upper()])
    with writer:
        connections = {
            name: writer.add_connection(name, msgtype, typestore=store)
            for name, msgtype in types.items()
        }
        decoders = {name: bag.decoder(name) for name in types}
        for raw in bag.messages(list(types)):
            message = _as_ros1(store, types[raw.topic], decoders[raw.topic](raw))
            data = store.serialize_ros1(message, types[raw.topic])
            writer.write(connections[raw.topic], raw.log_time_ns, data)
    return target


def _as_ros1(store, msgtype, message):
    """Return a message of ROS 2 as one of ROS 1, some of whose fields are in upper case."""
    fields = {}
    for name, (kind, detail) in store.fielddefs[msgtype][1]:
        # the header of ROS 1 has a counter
        value = getattr(message, name if hasattr(message, name) else name.lower(), 0)
        if kind == Nodetype.NAME:
            value = _as_ros1(store, detail, value)
        elif kind == Nodetype.SEQUENCE and detail[0][0] == Nodetype.NAME:
            value = [_as_ros1(store, detail[0][1], item) for item in value]
        fields[name] = value
    return store.types[msgtype](**fields)
