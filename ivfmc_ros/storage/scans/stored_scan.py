# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads the profiles of a scan from its bag, at the chunk offsets that the catalogue stores."""

from collections.abc import Iterator
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
import struct
from typing import IO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
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
from ivfmc_ros.errors import CellError
from ivfmc_ros.model import Profile
from ivfmc_ros.storage.bag.bag_file import RawMessage
from ivfmc_ros.storage.bag.reader import open_bag
from ivfmc_ros.storage.bag.summary import READ_ERRORS
from ivfmc_ros.storage.bag.summary import read_summary
from ivfmc_ros.storage.bag.writer import FILE_NAME
from ivfmc_ros.storage.bag.writer import PART_NAME
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.catalogue.rows import ProfileRow
from ivfmc_ros.storage.messages.point_clouds import to_profile

# Opcode and content length of an MCAP record.
_RECORD = struct.Struct('<BQ')


def load_profiles(
    root: Path, scan_id: str, cell_path: Path | None = None, camera_path: Path | None = None
) -> tuple[list[Profile], Cell]:
    """
    Load the profiles of a scan of the catalogue, and its cell.

    root : folder of the scans and of their catalogue
    cell_path, camera_path : files to use instead of those in the folder of the scan
    :raises CatalogueError: the scan does not exist, or has no profiles
    :raises BagError: the bag is missing or damaged
    :raises CellError: the calibration cannot be read
    """
    catalogue = Catalogue(root)
    folder = catalogue.scan(scan_id).folder
    camera = load_camera(camera_path or folder / 'camera.yaml')
    cell = load_cell(cell_path or folder / 'cell.yaml', camera)
    profiles = list(read_profiles(catalogue, scan_id))
    _require_lasers(profiles, cell, cell_path or folder / 'cell.yaml')
    return profiles, cell


def _require_lasers(profiles: Sequence[Profile], cell: Cell, path: Path) -> None:
    """:raises CellError: a profile was taken by a laser that the cell does not have."""
    greatest = max(profile.laser for profile in profiles)
    if greatest >= len(cell.lasers):
        names = ', '.join(laser.name for laser in cell.lasers)
        raise CellError(
            f'{path}: lasers: has {len(cell.lasers)} ({names}), the scan was taken with at least '
            f'{greatest + 1}; use the cell.yaml of the scan'
        )


def read_profiles(catalogue: Catalogue, scan_id: str) -> Iterator[Profile]:
    """
    Yield the profiles of a scan by seq, with the provisional angles of the recording.

    Only the chunks that hold profiles are read.

    :raises CatalogueError: the scan does not exist, or has no profiles
    :raises BagError: the bag is missing or damaged, or a profile is not where the catalogue says
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
                raw = RawMessage(
                    topic=row.topic, index=row.message, log_time_ns=row.log_time_ns, data=data
                )
                yield to_profile(decode(raw), f'{path}: {row.topic}, message {row.message}')
    except OSError as error:
        raise BagError(f'{path}: cannot be read: {error.strerror or error}') from error


def _bag_file(folder: Path) -> Path:
    # after a crash the part file has every profile of the catalogue
    for name in (FILE_NAME, PART_NAME):
        if (folder / name).is_file():
            return folder / name
    raise BagError(f'{folder / FILE_NAME}: there is no such file; restore the bag of the scan')


def _messages(
    stream: IO[bytes], rows: Sequence[ProfileRow], path: Path
) -> Iterator[tuple[ProfileRow, bytes]]:
    channels = _channels(stream, rows[0].topic, path)
    for offset, chunk_rows in groupby(rows, key=lambda row: row.chunk_offset):
        found = _messages_of_chunk(stream, offset, channels, path)
        for row in chunk_rows:
            if row.message not in found:
                raise BagError(
                    f'{path}: profile {row.seq} is not in the chunk at byte {offset}; the file '
                    'was changed'
                )
            yield row, found[row.message]


def _channels(stream: IO[bytes], topic: str, path: Path) -> set[int]:
    """Return the ids of the MCAP channels of a topic."""
    try:
        summary, _ = read_summary(path)
        if summary is not None:
            channels = summary.channels.values()
            return {channel.id for channel in channels if channel.topic == topic}
        stream.seek(0)
        return _channels_without_index(stream, topic)
    except READ_ERRORS as error:
        raise BagError(f'{path}: is damaged: {error}') from error


def _channels_without_index(stream: IO[bytes], topic: str) -> set[int]:
    for record in StreamReader(stream).records:
        if isinstance(record, Channel) and record.topic == topic:
            return {record.id}
    return set()


def _messages_of_chunk(
    stream: IO[bytes], offset: int, channels: set[int], path: Path
) -> dict[int, bytes]:
    """Return the messages of a topic in a chunk, by their index in the topic."""
    stream.seek(offset)
    head = stream.read(_RECORD.size)
    if len(head) < _RECORD.size or head[0] != Opcode.CHUNK:
        raise BagError(f'{path}: there is no chunk at byte {offset}; the file was changed')
    try:
        records = breakup_chunk(Chunk.read(ReadDataStream(stream)), validate_crc=True)
    except READ_ERRORS as error:
        raise BagError(f'{path}: the chunk at byte {offset} is damaged: {error}') from error
    return {
        record.sequence: record.data
        for record in records
        if isinstance(record, Message) and record.channel_id in channels
    }
