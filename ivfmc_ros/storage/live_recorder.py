# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Writes a scan as it runs.

Messages are queued, and one thread writes, compresses and flushes them: compression takes longer
than the callback of a picture may. The file is ``scan.mcap.part`` until it is whole; what was
flushed can be read from it at any time, and salvaged after a power cut.
"""

from collections.abc import Callable
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import field
import os
from pathlib import Path
import queue
import threading
import time
from typing import IO

from ivfmc_ros import files
from ivfmc_ros.errors import FileError
from ivfmc_ros.storage.bag import metadata
from ivfmc_ros.storage.bag import writer
from ivfmc_ros.storage.bag.chunk_file import ChunkFile
from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.storage.messages.profile_head import ProfileHead

PART_NAME = f'{writer.FILE_NAME}.part'

# A chunk holds what came within so many seconds or bytes: what is not in a chunk is not readable.
_FLUSH_S = 0.25
_CHUNK_BYTES = 8 * 1024 * 1024


@dataclass(frozen=True, kw_only=True)
class Place:
    """
    A profile that is in the file and flushed.

    index : counts the messages of the topic from 0
    chunk_offset : bytes from the beginning of the file to the chunk that holds it
    """

    mark: ProfileHead
    topic: str
    index: int
    log_time_ns: int
    chunk_offset: int


@dataclass(frozen=True, kw_only=True)
class _Item:
    topic: str
    msgtype: str
    data: bytes
    log_time_ns: int
    latched: bool
    mark: ProfileHead | None


@dataclass(kw_only=True)
class _Topic:
    id: int
    channel: metadata.Channel
    count: int = 0


@dataclass(kw_only=True)
class RecorderCounts:
    """How much was written, and what was not because the disk is too slow."""

    messages: int = 0
    bytes: int = 0
    dropped: int = 0
    dropped_topics: dict[str, int] = field(default_factory=dict)


class LiveRecorder:
    """
    A bag that is being recorded.

    ``recorded`` is the highest seq up to which every profile is in the file and flushed, or None.
    """

    def __init__(
        self,
        folder: Path,
        *,
        compress: bool = True,
        room: int = 256 * 1024 * 1024,
        flushed: Callable[[Sequence[Place]], None] = lambda places: None,
    ) -> None:
        """
        Begin the bag of a scan folder.

        room : bytes that may wait for the disk; what comes beyond is dropped and counted
        flushed : is called in the writing thread with the profiles of every flush
        :raises FileError: there is a bag already, or the file cannot be made
        """
        self.folder = folder
        self.counts = RecorderCounts()
        self.error: str | None = None
        self._flushed = flushed
        self._room = room
        self._waiting = 0
        self._lock = threading.Lock()
        self._queue: queue.Queue[_Item | None] = queue.Queue()
        self._sequence = _Sequence()
        self._topics: dict[str, _Topic] = {}
        self._schemas: dict[str, int] = {}
        self._span: tuple[int, int] | None = None
        self._chunk: list[tuple[_Item, int]] = []
        self._chunk_bytes = 0
        self._stream = _begin(folder)
        try:
            self._mcap = ChunkFile(self._stream, compress=compress)
            self._stream.flush()
        except OSError as error:
            raise _unwritten(folder, error) from error
        self._thread = threading.Thread(target=self._run, name='recorder', daemon=True)
        self._thread.start()

    @property
    def recorded(self) -> int | None:
        """Highest seq up to which every profile is in the file and flushed."""
        return self._sequence.highest

    @property
    def waiting(self) -> int:
        """Bytes that wait to be written."""
        return self._waiting

    def add(
        self,
        topic: str,
        msgtype: str,
        data: bytes,
        log_time_ns: int,
        *,
        latched: bool = False,
        mark: ProfileHead | None = None,
    ) -> bool:
        """
        Queue a message; returns False when it was dropped because too much waits.

        topic : its full name
        mark : of a profile, which is never dropped
        """
        with self._lock:
            if mark is None and self._waiting + len(data) > self._room:
                self.counts.dropped += 1
                lost = self.counts.dropped_topics
                lost[topic] = lost.get(topic, 0) + 1
                return False
            self._waiting += len(data)
        item = _Item(
            topic=topic,
            msgtype=msgtype,
            data=data,
            log_time_ns=log_time_ns,
            latched=latched,
            mark=mark,
        )
        self._queue.put(item)
        return True

    def stop(self) -> Path:
        """
        Write what waits, end the file, and give it its name; blocks until that is done.

        :raises FileError: something could not be written; the file stays ``scan.mcap.part``
        """
        self._queue.put(None)
        self._thread.join()
        if self.error is not None:
            raise FileError(self.error)
        return self.folder / writer.FILE_NAME

    def _run(self) -> None:
        try:
            self._write_all()
            self._finish()
        except Exception as error:
            reason = getattr(error, 'strerror', None) or error
            self.error = f'{self.folder / PART_NAME}: cannot be written: {reason}'
            self._drain()
        finally:
            self._stream.close()

    def _write_all(self) -> None:
        due = time.monotonic() + _FLUSH_S
        while True:
            try:
                item = self._queue.get(timeout=max(0.0, due - time.monotonic()))
            except queue.Empty:
                item = _TICK
            if item is None:
                break
            if item is not _TICK:
                self._write(item)
            if self._chunk_bytes >= _CHUNK_BYTES or time.monotonic() >= due:
                self._flush()
                due = time.monotonic() + _FLUSH_S
        self._flush()

    def _write(self, item: _Item) -> None:
        topic = self._topics.get(item.topic) or self._open(item)
        if topic.channel.msgtype != item.msgtype:
            raise FileError(f'{item.topic} holds {topic.channel.msgtype}, not {item.msgtype}')
        self._mcap.add(topic.id, item.log_time_ns, item.data, topic.count)
        self._chunk.append((item, topic.count))
        self._chunk_bytes += len(item.data)
        topic.count += 1
        start, end = self._span or (item.log_time_ns, item.log_time_ns)
        self._span = min(start, item.log_time_ns), max(end, item.log_time_ns)

    def _open(self, item: _Item) -> _Topic:
        if not cdr.knows(item.msgtype):
            raise FileError(f'{item.topic}: no definition of {item.msgtype} is known')
        channel = metadata.Channel(
            topic=item.topic,
            msgtype=item.msgtype,
            type_hash=cdr.type_hash(item.msgtype),
            latched=item.latched,
        )
        if item.msgtype not in self._schemas:
            text = cdr.definition(item.msgtype)
            self._schemas[item.msgtype] = self._mcap.schema(item.msgtype, text)
        number = self._mcap.channel(
            item.topic,
            cdr.ENCODING,
            self._schemas[item.msgtype],
            {
                'offered_qos_profiles': metadata.dump(metadata.qos(channel)),
                'topic_type_hash': channel.type_hash,
            },
        )
        self._topics[item.topic] = _Topic(id=number, channel=channel)
        return self._topics[item.topic]

    def _flush(self) -> None:
        if not self._chunk:
            return
        offset = self._mcap.flush()
        places = [
            Place(
                mark=item.mark,
                topic=item.topic,
                index=index,
                log_time_ns=item.log_time_ns,
                chunk_offset=offset,
            )
            for item, index in self._chunk
            if item.mark is not None
        ]
        with self._lock:
            self._waiting -= self._chunk_bytes
        self.counts.messages += len(self._chunk)
        self.counts.bytes += self._chunk_bytes
        self._chunk, self._chunk_bytes = [], 0
        for place in places:
            self._sequence.add(place.mark.seq)
        if places:
            self._flushed(places)

    def _finish(self) -> None:
        channels = [
            metadata.Channel(**{**vars(topic.channel), 'count': topic.count})
            for topic in self._topics.values()
        ]
        info = metadata.information(writer.FILE_NAME, channels, *(self._span or (0, 0)))
        self._mcap.metadata('rosbag2', {'serialized_metadata': metadata.dump(info)})
        self._mcap.finish()
        self._stream.flush()
        os.fsync(self._stream.fileno())
        (self.folder / PART_NAME).rename(self.folder / writer.FILE_NAME)
        document = metadata.dump({'rosbag2_bagfile_information': info})
        files.write_text(self.folder / metadata.FILE_NAME, document)

    def _drain(self) -> None:
        # who adds must not wait for a thread that writes no more
        while (item := self._queue.get()) is not None:
            with self._lock:
                self._waiting -= len(item.data)
            self.counts.dropped += 1


class _Sequence:
    """The highest number up to which all have come, whatever their order."""

    def __init__(self) -> None:
        self.highest: int | None = None
        self._beyond: set[int] = set()

    def add(self, seq: int) -> None:
        self._beyond.add(seq)
        following = 0 if self.highest is None else self.highest + 1
        while following in self._beyond:
            self._beyond.remove(following)
            self.highest = following
            following += 1


_TICK = _Item(topic='', msgtype='', data=b'', log_time_ns=0, latched=False, mark=None)


def _begin(folder: Path) -> IO[bytes]:
    whole = folder / writer.FILE_NAME
    if whole.exists():
        raise FileError(f'{whole}: exists already and is not overwritten')
    try:
        # x: a bag that was cut off is somebody's scan, too
        return (folder / PART_NAME).open('xb')
    except FileExistsError:
        raise FileError(f'{folder / PART_NAME}: exists already and is not overwritten') from None
    except OSError as error:
        raise _unwritten(folder, error) from error


def _unwritten(folder: Path, error: OSError) -> FileError:
    return FileError(f'{folder / PART_NAME}: cannot be written: {error.strerror or error}')
