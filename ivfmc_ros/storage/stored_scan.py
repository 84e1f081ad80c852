# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The points of a scan, retrieved through the catalogue from their places in the bag."""

from collections.abc import Iterator
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
import struct
from typing import IO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel
from mcap.records import Chunk
from mcap.records import Message
from mcap.stream_reader import breakup_chunk
from mcap.stream_reader import StreamReader

from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.cell_file import load_cell
from ivfmc_ros.errors import BagError
from ivfmc_ros.errors import CatalogueError
from ivfmc_ros.model import Profile
from ivfmc_ros.storage.bag.reader import DAMAGE
from ivfmc_ros.storage.bag.reader import open_bag
from ivfmc_ros.storage.bag.reader import Raw
from ivfmc_ros.storage.bag.writer import FILE_NAME
from ivfmc_ros.storage.catalogue import Catalogue
from ivfmc_ros.storage.catalogue import ProfileRow
from ivfmc_ros.storage.live_recorder import PART_NAME
from ivfmc_ros.storage.messages.point_clouds import to_profile

_RECORD = struct.Struct('<BQ')


def retrieve(
    root: Path, scan_id: str, cell_path: Path | None = None, camera_path: Path | None = None
) -> tuple[list[Profile], Cell]:
    """
    Return the stored profiles of a scan of the catalogue, and its cell.

    cell_path, camera_path : to use instead of those in the folder of the scan
    :raises CatalogueError: there is no such scan, or it has no profiles
    :raises BagError: the bag is missing or damaged
    :raises CellError: the calibration cannot be read
    """
    catalogue = Catalogue(root)
    folder = catalogue.scan(scan_id).folder
    camera = load_camera(camera_path or folder / 'camera.yaml')
    cell = load_cell(cell_path or folder / 'cell.yaml', camera)
    return list(stored_profiles(catalogue, scan_id)), cell


def stored_profiles(catalogue: Catalogue, scan_id: str) -> Iterator[Profile]:
    """
    Yield the profiles of a scan by their seq, provisional angles as they were recorded.

    Only the chunks that hold profiles are read, at the places that the catalogue names.

    :raises CatalogueError: there is no such scan, or it has no profiles
    :raises BagError: the bag is missing or damaged, or a profile is not where it should be
    """
    folder = catalogue.scan(scan_id).folder
    rows = catalogue.profiles(scan_id)
    if not rows:
        raise CatalogueError(f'{catalogue.path}: scan {scan_id!r} has no profiles')
    path = _bag_file(folder)
    bag = open_bag(path, salvage=path.name == PART_NAME)
    decode = bag.decoder(rows[0].topic)
    try:
        with path.open('rb') as stream:
            for row, data in _messages(stream, rows, path):
                raw = Raw(
                    topic=row.topic, index=row.message, log_time_ns=row.log_time_ns, data=data
                )
                yield to_profile(decode(raw), f'{path}: {row.topic}, message {row.message}')
    except OSError as error:
        raise BagError(f'{path}: cannot be read: {error.strerror or error}') from error


def _bag_file(folder: Path) -> Path:
    # one that was cut off holds what the catalogue knows of
    for name in (FILE_NAME, PART_NAME):
        if (folder / name).is_file():
            return folder / name
    raise BagError(f'{folder / FILE_NAME}: there is no such file; the scan has lost its bag')


def _messages(
    stream: IO[bytes], rows: Sequence[ProfileRow], path: Path
) -> Iterator[tuple[ProfileRow, bytes]]:
    channels = _channels(stream, rows[0].topic, path)
    for offset, of_chunk in groupby(rows, key=lambda row: row.chunk_offset):
        found = _chunk(stream, offset, channels, path)
        for row in of_chunk:
            if row.message not in found:
                raise BagError(
                    f'{path}: profile {row.seq} is not in the chunk at byte {offset}, where the '
                    'catalogue says it is'
                )
            yield row, found[row.message]


def _channels(stream: IO[bytes], topic: str, path: Path) -> set[int]:
    """Return the numbers by which messages of a topic are known."""
    try:
        summary = None if path.name == PART_NAME else make_reader(stream).get_summary()
        if summary is not None:
            known = summary.channels.values()
            return {channel.id for channel in known if channel.topic == topic}
        stream.seek(0)
        return _channels_of_part(stream, topic)
    except DAMAGE as error:
        raise BagError(f'{path}: is damaged: {error}') from error


def _channels_of_part(stream: IO[bytes], topic: str) -> set[int]:
    for record in StreamReader(stream).records:
        if isinstance(record, Channel) and record.topic == topic:
            return {record.id}
    return set()


def _chunk(stream: IO[bytes], offset: int, channels: set[int], path: Path) -> dict[int, bytes]:
    """Return the messages of a topic in a chunk, by their number in it."""
    stream.seek(offset)
    head = stream.read(_RECORD.size)
    if len(head) < _RECORD.size or head[0] != Opcode.CHUNK:
        raise BagError(f'{path}: there is no chunk at byte {offset}; the file was changed')
    try:
        records = breakup_chunk(Chunk.read(ReadDataStream(stream)), validate_crc=True)
    except DAMAGE as error:
        raise BagError(f'{path}: the chunk at byte {offset} is damaged: {error}') from error
    return {
        record.sequence: record.data
        for record in records
        if isinstance(record, Message) and record.channel_id in channels
    }
