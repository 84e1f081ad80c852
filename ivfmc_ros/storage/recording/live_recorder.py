# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Records messages to the bag of a running scan in a thread of its own.

Callers only enqueue: compressing an image takes longer than a callback may. What has been flushed
can be read from ``scan.mcap.part`` at any time, and after a power cut.
"""

from collections.abc import Callable
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import field
from pathlib import Path
import queue
import threading
import time

from ivfmc_ros.errors import BagError
from ivfmc_ros.errors import FileError
from ivfmc_ros.storage.bag.writer import BagWriter
from ivfmc_ros.storage.bag.writer import FILE_NAME
from ivfmc_ros.storage.messages.profile_header import ProfileHeader
from ivfmc_ros.storage.recording.profile_location import ProfileLocation
from ivfmc_ros.storage.recording.taken_profiles import TakenProfiles

# A chunk is written after this time, seconds: only messages in a chunk can be read.
_FLUSH_S = 0.25
# ... or at this uncompressed size, bytes: about six images of 1.3 MB.
_CHUNK_BYTES = 8 * 1024 * 1024


@dataclass(frozen=True, kw_only=True)
class _QueuedMessage:
    topic: str
    msgtype: str
    data: bytes
    log_time_ns: int
    latched: bool
    header: ProfileHeader | None


@dataclass(kw_only=True)
class RecorderCounts:
    """
    Number of written and of dropped messages.

    bytes : size of the written messages, before compression
    dropped : messages that did not fit into the queue, because the disk is too slow
    dropped_topics : their number by topic
    """

    messages: int = 0
    bytes: int = 0
    dropped: int = 0
    dropped_topics: dict[str, int] = field(default_factory=dict)


class LiveRecorder:
    """
    Records a bag; ``add`` enqueues a message, a thread writes it.

    counts : numbers of messages, for diagnostics
    error : why the recording has failed, or None
    """

    def __init__(
        self,
        folder: Path,
        *,
        first_profile: int = 0,
        compress: bool = True,
        max_queued_bytes: int = 256 * 1024 * 1024,
        on_flush: Callable[[Sequence[ProfileLocation]], None] = lambda locations: None,
    ) -> None:
        """
        Open the bag in the folder of a scan and start the thread.

        first_profile : number of profiles that the bag of an interrupted recording has, behind
            which this one goes on; it is read as a whole. 0: a new bag
        compress : compress chunks by zstd
        max_queued_bytes : limit of the queue; messages beyond it are dropped and counted
        on_flush : is called in the thread with the profiles of every written chunk, and before
            with those that the bag has
        :raises FileError: the folder has a bag, or the file cannot be created
        :raises BagError: the bag of an interrupted recording is damaged, or has not so many
            profiles
        """
        self.folder = folder
        self.counts = RecorderCounts()
        self.error: str | None = None
        self._on_flush = on_flush
        self._max_queued_bytes = max_queued_bytes
        self._queued_bytes = 0
        self._lock = threading.Lock()
        self._queue: queue.Queue[_QueuedMessage | None] = queue.Queue()
        self._recorded = _ContiguousCounter(first_profile)
        self._chunk: list[tuple[_QueuedMessage, int]] = []
        self._view: int | None = None
        taken = TakenProfiles()
        self._bag = BagWriter(
            folder, append=first_profile > 0, visit=taken, compress=compress, chunk_bytes=None
        )
        if first_profile:
            self._go_on(taken, first_profile)
        self._thread = threading.Thread(target=self._run, name='recorder', daemon=True)
        self._thread.start()

    def _go_on(self, taken: TakenProfiles, first_profile: int) -> None:
        try:
            taken.require_complete(self.folder, first_profile)
        except BagError:
            self._bag.close()
            raise
        self.counts.messages, self.counts.bytes = self._bag.kept_messages, self._bag.kept_bytes
        self._on_flush(taken.locations)

    @property
    def recorded(self) -> int | None:
        """Highest seq up to which every profile has been flushed, or None."""
        return self._recorded.highest

    @property
    def queued_bytes(self) -> int:
        """Size of the messages that have not been flushed."""
        return self._queued_bytes

    def add(
        self,
        topic: str,
        msgtype: str,
        data: bytes,
        log_time_ns: int,
        *,
        latched: bool = False,
        header: ProfileHeader | None = None,
    ) -> bool:
        """
        Enqueue a message that is encoded as CDR.

        topic : absolute name
        msgtype : such as 'sensor_msgs/msg/Image'
        latched : the topic's publisher is transient local
        header : header of a profile message; profiles are never dropped
        :returns: False where the message was dropped because the queue is full
        """
        with self._lock:
            if header is None and self._queued_bytes + len(data) > self._max_queued_bytes:
                self.counts.dropped += 1
                dropped = self.counts.dropped_topics
                dropped[topic] = dropped.get(topic, 0) + 1
                return False
            self._queued_bytes += len(data)
        message = _QueuedMessage(
            topic=topic,
            msgtype=msgtype,
            data=data,
            log_time_ns=log_time_ns,
            latched=latched,
            header=header,
        )
        self._queue.put(message)
        return True

    def stop(self) -> Path:
        """
        Write the queued messages and finish the bag; blocks until that is done.

        :returns: path of ``scan.mcap``
        :raises FileError: the bag could not be written; it stays ``scan.mcap.part``
        """
        self._queue.put(None)
        self._thread.join()
        if self.error is not None:
            raise FileError(self.error)
        return self.folder / FILE_NAME

    def _run(self) -> None:
        try:
            self._write_all()
            self._bag.finish()
        except FileError as error:
            self._fail(str(error))
        except Exception as error:
            self._fail(f'{self.folder}: the bag cannot be written: {error}')
        finally:
            self._bag.close()

    def _write_all(self) -> None:
        due = time.monotonic() + _FLUSH_S
        while True:
            try:
                message = self._queue.get(timeout=max(0.0, due - time.monotonic()))
            except queue.Empty:
                message = _NO_MESSAGE
            if message is None:
                break
            if message is not _NO_MESSAGE:
                self._write(message)
            if self._bag.pending_bytes >= _CHUNK_BYTES or time.monotonic() >= due:
                self._flush()
                due = time.monotonic() + _FLUSH_S
        self._flush()

    def _write(self, message: _QueuedMessage) -> None:
        index = self._bag.write(
            message.topic,
            message.msgtype,
            message.data,
            message.log_time_ns,
            latched=message.latched,
        )
        self._chunk.append((message, index))

    def _flush(self) -> None:
        size = self._bag.pending_bytes
        offset = self._bag.flush()
        if offset is None:
            return
        locations = [
            ProfileLocation(
                header=message.header,
                topic=message.topic,
                index=index,
                log_time_ns=message.log_time_ns,
                chunk_offset=offset,
            )
            for message, index in self._chunk
            if message.header is not None
        ]
        with self._lock:
            self._queued_bytes -= size
        self.counts.messages += len(self._chunk)
        self.counts.bytes += size
        self._chunk = []
        for location in locations:
            self._recorded.add(location.header.seq)
        if locations:
            self._on_flush(locations)
            self._sync_ended_view(locations[-1].header.view)

    def _sync_ended_view(self, view: int) -> None:
        """Force the views before this one to the disk; ``finish`` does so for the last one."""
        if self._view is not None and view != self._view:
            self._bag.sync()
        self._view = view

    def _fail(self, error: str) -> None:
        """Store the error and discard messages until ``stop``, so that the queue never fills."""
        self.error = error
        while (message := self._queue.get()) is not None:
            with self._lock:
                self._queued_bytes -= len(message.data)
            self.counts.dropped += 1


class _ContiguousCounter:
    """The highest number up to which all numbers have been added, in any order."""

    def __init__(self, first: int) -> None:
        """``first`` : number of those that were added before, from 0."""
        self.highest: int | None = first - 1 if first else None
        self._beyond: set[int] = set()

    def add(self, number: int) -> None:
        self._beyond.add(number)
        following = 0 if self.highest is None else self.highest + 1
        while following in self._beyond:
            self._beyond.remove(following)
            self.highest = following
            following += 1


# Stands for a time-out of the queue; None ends the recording.
_NO_MESSAGE = _QueuedMessage(
    topic='', msgtype='', data=b'', log_time_ns=0, latched=False, header=None
)
