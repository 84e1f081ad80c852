# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of other recorders, and ours in the hands of other software."""

from collections.abc import Iterator
import os
from pathlib import Path

from mcap_ros2.reader import read_ros2_messages
from rosbags.highlevel import AnyReader
from support.bag_variants import frames_of
from support.bag_variants import is_same
from support.bag_variants import variants
from support.bag_variants import write_scan
from support.recordings import write_profiles

from bench import at_least
from bench import at_most
from bench import Number
from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.bag.reader import open_bag

_ROOT = Path(__file__).resolve().parents[2]
# The one of them whose messages are not CDR.
_REFUSED = ('wrong_rmw.mcap',)


def foreign_bags(folder: Path) -> Iterator[Number]:
    yield from written(folder / 'variants')
    yield from downloaded()
    yield from ours(folder / 'ours')


def written(folder: Path) -> Iterator[Number]:
    """Read one scan in the format of each writer."""
    source = write_scan(folder / 'source')
    expected = frames_of(source)
    wrong = []
    found = variants()
    for name, write in found.items():
        (folder / name).mkdir()
        try:
            is_right = is_same(frames_of(write(source, folder / name / 'theirs')), expected)
        except BagError as error:
            print(f'storage: {name}: {error}')
            is_right = False
        if not is_right:
            wrong.append(name)
    note = f'of {len(found)}: {", ".join(found)}'
    yield Number('variants_read', len(found) - len(wrong), 'bags', at_least(len(found)), note)


def downloaded() -> Iterator[Number]:
    """Read the bags of rosbag2's own tests."""
    data = Path(os.environ.get('IVFMC_DATA', _ROOT.parent / 'shared' / 'data')) / 'bags'
    files = sorted(data.glob('*.mcap'))
    if not files:
        raise FileNotFoundError(f'{data}: has no bags; IVFMC_DATA names the folder of the data')
    read, refused, wrong = [], [], []
    for file in files:
        try:
            bag = open_bag(file)
            decoders = {name: bag.decoder(name) for name in bag.topics}
            count = sum(1 for raw in bag.messages(bag.topics) if decoders[raw.topic](raw))
        except BagError as error:
            is_named = file.name in str(error) and file.name in _REFUSED
            (refused if is_named else wrong).append(file.name)
        else:
            is_whole = count == bag.message_count and file.name not in _REFUSED
            (read if is_whole else wrong).append(file.name)
    note = f'{", ".join(read)}; refused by name: {", ".join(refused)}; wrong: {", ".join(wrong)}'
    answered = len(read) + len(refused)
    yield Number('shared_bags', answered, 'bags', at_least(len(files)), note)


def ours(folder: Path) -> Iterator[Number]:
    """Decode all messages of our bags by rosbags and by the mcap library."""
    folder.mkdir()
    write_scan(folder / 'pictures')
    write_profiles(folder / 'profiles', range(12), per_chunk=3)
    missing = 0
    whole = 0
    for name in ('pictures', 'profiles'):
        bag = folder / name
        expected = open_bag(bag).message_count
        whole += expected
        with AnyReader([bag]) as reader:
            decoded = sum(
                reader.deserialize(data, connection.msgtype) is not None
                for connection, _, data in reader.messages()
            )
        missing += expected - decoded
        messages = read_ros2_messages(str(bag / 'scan.mcap'))
        missing += expected - sum(message.ros_msg is not None for message in messages)
    note = f'of {whole} in our bags, by rosbags and by the mcap library'
    yield Number('ours_not_decoded', missing, 'messages', at_most(0), note)
