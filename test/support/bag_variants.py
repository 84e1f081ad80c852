# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One small scan in each format of other recorders that is read, written by mcap and rosbags."""

from collections.abc import Callable
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType
from mcap.writer import IndexType
from mcap.writer import Writer as McapWriter
import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.rosbag2 import CompressionFormat
from rosbags.rosbag2 import CompressionMode
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import get_typestore
from rosbags.typesys import Stores
import yaml
import zstandard

from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.model import Frame
from ivfmc_ros.storage.bag.reader import open_bag
from ivfmc_ros.storage.bag.writer import create_bag
from ivfmc_ros.storage.scans.scan_bag import open_scan
from support.foreign_bags import split_sqlite
from support.foreign_bags import write_ros1
from support.foreign_bags import write_rosbag2
from support.foreign_bags import write_sqlite

START = 1_700_000_000_000_000_000
_PERIOD_NS = 100_000_000
_SEPARATOR = '=' * 80
# rosbag2 of Humble: versions 5 and 6 have the QoS as text, and neither hashes nor a distribution.
_HUMBLE = 5
_DISTRIBUTIONS = {
    'foxy': Stores.ROS2_FOXY,
    'humble': Stores.ROS2_HUMBLE,
    'iron': Stores.ROS2_IRON,
    'jazzy': Stores.ROS2_JAZZY,
    'kilted': Stores.ROS2_KILTED,
    # the newest that rosbags knows, for Rolling
    'rolling': Stores.ROS2_LYRICAL,
}


def write_scan(folder: Path, count: int = 6) -> Path:
    """Write the scan in our own format: images of 64 x 48, 0.1 s and 0.1 rad apart."""
    camera = Camera(
        width=64,
        height=48,
        K=np.array([[90.0, 0, 31.5], [0, 91.0, 23.5], [0, 0, 1]]),
        distortion=np.array([-0.1, 0.02, 0.001, -0.002, 0.0]),
    )
    rng = np.random.default_rng(7)
    with create_bag(folder) as bag:
        for index in range(count):
            stamp = START + index * _PERIOD_NS
            bag.joint_state(stamp, 'turntable_joint', 0.1 * index)
            bag.camera_info(stamp, camera)
            bag.image(stamp, rng.integers(0, 255, (48, 64), dtype=np.uint8))
    return folder


def variants() -> dict[str, Callable[[Path, Path], Path]]:
    """Return by name the functions that write a bag in another format: (source, target) -> bag."""
    found: dict[str, Callable[[Path, Path], Path]] = {
        'mcap_none': partial(write_mcap, compression=CompressionType.NONE),
        'mcap_lz4': partial(write_mcap, compression=CompressionType.LZ4),
        'mcap_zstd': partial(write_mcap, compression=CompressionType.ZSTD),
        'mcap_no_index': partial(write_mcap, index_types=IndexType.NONE),
        'mcap_no_summary': partial(
            write_mcap, index_types=IndexType.NONE, use_statistics=False, repeat_channels=False,
            repeat_schemas=False, use_summary_offsets=False,
        ),
        'mcap_no_chunks': partial(write_mcap, use_chunking=False),
        'mcap_no_crcs': partial(write_mcap, enable_crcs=False),
        'mcap_idl': partial(write_mcap, idl=True),
        'mcap_whole_file_zstd': whole_file_zstd,
        'mcap_split': split_mcap,
        'sqlite': lambda source, target: write_sqlite(source, target).parent,
        'sqlite_file': write_sqlite,
        'sqlite_no_definitions': partial(write_sqlite, definitions=False),
        'sqlite_split': partial(split_sqlite, at=7),
        'ros1': partial(_ros1, compression=None),
        'ros1_bz2': partial(_ros1, compression='bz2'),
        'ros1_lz4': partial(_ros1, compression='lz4'),
    }  # fmt: skip
    for storage in (StoragePlugin.MCAP, StoragePlugin.SQLITE3):
        for mode in (CompressionMode.NONE, CompressionMode.FILE, CompressionMode.MESSAGE):
            name = f'rosbag2_{storage.name.lower()}_{mode.name.lower()}'
            found[name] = partial(_rosbag2, storage=storage, mode=mode)
    for name, store in _DISTRIBUTIONS.items():
        found[f'definitions_{name}'] = partial(write_mcap, store=store)
    found['metadata_humble'] = humble_metadata
    return found


def write_mcap(
    source: Path, target: Path, *, idl: bool = False, store: Stores | None = None, **options: Any
) -> Path:
    """
    Write an MCAP file by the mcap library and return it.

    idl : definitions in OMG IDL
    store : release of ROS whose definitions are written
    """
    bag = open_bag(source)
    path = target.with_name(f'{target.name}.mcap')
    with path.open('wb') as stream:
        writer = McapWriter(stream, **options)
        writer.start(profile='ros2')
        channels = {}
        for name, topic in bag.topics.items():
            text = topic.definition
            if idl:
                text = idl_definition(topic.msgtype)
            elif store is not None:
                text, _ = get_typestore(store).generate_msgdef(topic.msgtype, ros_version=2)
            encoding = 'ros2idl' if idl else 'ros2msg'
            schema = writer.register_schema(topic.msgtype, encoding, text.encode())
            channels[name] = writer.register_channel(name, 'cdr', schema)
        for raw in bag.messages(list(bag.topics)):
            writer.add_message(channels[raw.topic], raw.log_time_ns, raw.data, raw.log_time_ns)
        writer.finish()
    return path


def whole_file_zstd(source: Path, target: Path) -> Path:
    """Compress the file of a bag, as ``ros2 bag record --compression-mode file`` does."""
    [plain] = source.glob('*.mcap')
    path = target.with_name(f'{target.name}.mcap.zstd')
    path.write_bytes(zstandard.ZstdCompressor().compress(plain.read_bytes()))
    return path


def split_mcap(source: Path, target: Path) -> Path:
    """Write a folder of two files without metadata.yaml."""
    target.mkdir()
    bag = open_bag(source)
    messages = list(bag.messages(list(bag.topics)))
    half = len(messages) // 2
    for number, part in enumerate((messages[:half], messages[half:])):
        with create_bag(target / 'part') as writer:
            for raw in part:
                topic = bag.topics[raw.topic]
                writer.write(raw.topic, topic.msgtype, raw.data, raw.log_time_ns)
        (target / 'part' / 'scan.mcap').rename(target / f'bag_{number}.mcap')
        (target / 'part' / 'metadata.yaml').unlink()
        (target / 'part').rmdir()
    return target


def humble_metadata(source: Path, target: Path) -> Path:
    """Write a bag folder whose metadata.yaml is of the version of ROS 2 Humble."""
    write_rosbag2(source, target, storage=StoragePlugin.MCAP)
    path = target / 'metadata.yaml'
    document = yaml.safe_load(path.read_text())
    info = document['rosbag2_bagfile_information']
    info['version'] = _HUMBLE
    for key in ('custom_data', 'ros_distro'):
        info.pop(key, None)
    for entry in info['topics_with_message_count']:
        topic = entry['topic_metadata']
        topic.pop('type_description_hash', None)
        topic['offered_qos_profiles'] = yaml.safe_dump(topic['offered_qos_profiles'])
    path.write_text(yaml.safe_dump(document))
    return target


def _rosbag2(source: Path, target: Path, *, storage: Any, mode: Any) -> Path:
    compression = None if mode is CompressionMode.NONE else (mode, CompressionFormat.ZSTD)
    write_rosbag2(source, target, storage=storage, compression=compression)
    return target


def _ros1(source: Path, target: Path, *, compression: str | None) -> Path:
    return Path(
        write_ros1(source, target.with_name(f'{target.name}.bag'), compression=compression)
    )


def idl_definition(msgtype: str) -> str:
    """Return the definition of a type of Jazzy and of all that it needs, as rosbag2 stores IDL."""
    fields = get_typestore(Stores.ROS2_JAZZY).fielddefs
    names, waiting = [], [msgtype]
    while waiting:
        name = waiting.pop(0)
        if name not in names:
            names.append(name)
            waiting += [found for _, kind in fields[name][1] for found in _types_of(kind)]
    return ''.join(
        f'{_SEPARATOR}\nIDL: {name}\n{_struct(name, fields[name][1])}' for name in names
    )


def _types_of(kind: Any) -> Iterator[str]:
    node, detail = kind
    if node == Nodetype.NAME:
        yield detail
    elif node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        yield from _types_of(detail[0])


def _struct(name: str, fields: Any) -> str:
    package, _, short = name.split('/')
    types, members = [], []
    for field, (node, detail) in fields:
        text = _idl_type((node, detail))
        if node == Nodetype.ARRAY:
            # rosidl names a type for each array
            item = _idl_type(detail[0])
            text = f'{item}__{detail[1]}'
            types.append(f'typedef {item} {text}[{detail[1]}];\n')
        members.append(f'{text} {field};\n')
    body = ''.join(dict.fromkeys(types)) + f'struct {short} {{\n{"".join(members)}}};\n'
    return f'module {package} {{ module msg {{\n{body}}}; }};\n'


def _idl_type(kind: Any) -> str:
    node, detail = kind
    if node == Nodetype.BASE:
        return _IDL_TYPES.get(detail[0], detail[0])
    if node == Nodetype.NAME:
        return str(detail).replace('/', '::')
    return f'sequence<{_idl_type(detail[0])}>'


_IDL_TYPES = {'bool': 'boolean', 'float32': 'float', 'float64': 'double'}


def frames_of(path: Path) -> list[Frame]:
    """Return the frames of a scan in a bag."""
    return list(open_scan(path).frames())


def is_same(found: list[Frame], expected: list[Frame]) -> bool:
    """Tell whether frames are the same to the bit."""
    return len(found) == len(expected) and all(
        (one.stamp_ns, one.angle, one.laser, one.view) == (two.stamp_ns, two.angle, two.laser,
                                                           two.view)
        and np.array_equal(one.image, two.image)
        for one, two in zip(found, expected, strict=True)
    )  # fmt: skip
