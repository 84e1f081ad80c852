# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Writes bags that ``ros2 bag play`` reads: an MCAP file and ``metadata.yaml``.

``BagWriter`` writes into an existing folder, chunk by chunk: after a crash the file can be read up
to its last chunk, and another writer can go on behind it. ``create_bag`` makes a new folder, which
appears complete or not at all.
"""

from collections.abc import Iterator
from collections.abc import Mapping
from contextlib import contextmanager
from contextlib import suppress
from dataclasses import dataclass
import fcntl
import os
from pathlib import Path
from typing import Any
from typing import IO

from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.errors import FileError
from ivfmc_ros.files import atomic_folder
from ivfmc_ros.files import write_text
from ivfmc_ros.model import Image
from ivfmc_ros.storage.bag import metadata
from ivfmc_ros.storage.bag.mcap_writer import McapWriter
from ivfmc_ros.storage.bag.unfinished_mcap import ignore_message
from ivfmc_ros.storage.bag.unfinished_mcap import read_written_part
from ivfmc_ros.storage.bag.unfinished_mcap import Visit
from ivfmc_ros.storage.bag.unfinished_mcap import WrittenPart
from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.storage.messages import sensor_messages

# The MCAP file of a bag folder, and its name until it is complete.
FILE_NAME = 'scan.mcap'
PART_NAME = f'{FILE_NAME}.part'
NAMESPACE = '/ivfmc'

# Default size at which a chunk is written, uncompressed bytes; that of the mcap library.
CHUNK_BYTES = 1024 * 1024

# Topics whose publishers are transient local: a late subscriber needs the last message.
_LATCHED = ('laser_states',)


@dataclass(kw_only=True)
class _OpenTopic:
    """
    A topic that has messages.

    id : of its MCAP channel
    count : number of messages
    following : index of the next one; messages that were lost before have an index, too
    """

    id: int
    metadata: metadata.TopicMetadata
    count: int = 0
    following: int = 0


class BagWriter:
    """
    Writes messages to ``scan.mcap.part``, which becomes ``scan.mcap`` when it is complete.

    Every message is logged at the stamp that the caller passes, in nanoseconds. ``close`` without
    ``finish`` leaves ``scan.mcap.part``, as a crash does.

    pending_bytes : size of the messages that no chunk in the file has yet
    kept_messages, kept_bytes : number and size of the messages that the bag had when it was opened
    """

    def __init__(
        self,
        folder: Path,
        *,
        append: bool = False,
        visit: Visit = ignore_message,
        namespace: str = NAMESPACE,
        compress: bool = True,
        chunk_bytes: int | None = CHUNK_BYTES,
        label: str = '',
    ) -> None:
        """
        Open the file.

        folder : must exist and have no bag, unless ``append``
        append : go on behind the last whole chunk of the bag that an interrupted recorder left or
            finished; what follows that chunk is cut off
        visit : called with each message that such a bag keeps
        namespace : is put before relative names of topics
        compress : compress chunks by zstd; 3 ms for an image of 1.3 MB
        chunk_bytes : uncompressed size at which a chunk is written; None: only by ``flush``
        label : path that errors name instead of the file
        :raises FileError: the folder has a bag, complete or not, or cannot be written; with
            ``append``: it has none, or one that is being recorded
        :raises BagError: the bag is damaged before its last chunk, or another program wrote it
        """
        self.folder = folder
        self.pending_bytes = self._pending_messages = 0
        self._label = label or str(folder / PART_NAME)
        self._namespace = namespace.rstrip('/')
        self._chunk_bytes = chunk_bytes
        self._topics: dict[str, _OpenTopic] = {}
        self._schemas: dict[tuple[str, str], int] = {}
        self._span_ns: tuple[int, int] | None = None
        self.kept_messages = self.kept_bytes = 0
        written = None
        if append:
            self._stream, written = self._reopen_file(visit)
            self._take_over(written)
        else:
            self._stream = self._open_file()
        with self._named_errors():
            self._mcap = McapWriter(self._stream, compress=compress, written=written)
            self._stream.flush()

    def image(self, stamp_ns: int, image: Image) -> None:
        """Write an image, (height, width) mono or (height, width, 3) BGR, on ``image_raw``."""
        self._write_message('image_raw', stamp_ns, sensor_messages.image(stamp_ns, image))

    def compressed_image(self, stamp_ns: int, data: bytes, format: str) -> None:
        """Write the bytes of a 'jpeg' or 'png' file on ``image_raw/compressed``."""
        message = sensor_messages.compressed_image(stamp_ns, data, format)
        self._write_message('image_raw/compressed', stamp_ns, message)

    def camera_info(self, stamp_ns: int, camera: Camera) -> None:
        """Write the camera's calibration on ``camera_info``."""
        message = sensor_messages.camera_info(stamp_ns, camera)
        self._write_message('camera_info', stamp_ns, message)

    def joint_state(
        self, stamp_ns: int, name: str, position: float, velocity: float | None = None
    ) -> None:
        """Write a joint's position, rad, and velocity, rad/s, on ``joint_states``."""
        message = sensor_messages.joint_state(stamp_ns, {name: position}, velocity)
        self._write_message('joint_states', stamp_ns, message)

    def laser_state(self, stamp_ns: int, is_on: Mapping[str, bool]) -> None:
        """Write the states of the lasers, by name, on ``laser_states``."""
        positions = {name: float(on) for name, on in is_on.items()}
        message = sensor_messages.joint_state(stamp_ns, positions)
        self._write_message('laser_states', stamp_ns, message)

    def write(
        self,
        topic: str,
        msgtype: str,
        data: bytes,
        stamp_ns: int,
        *,
        definition: str | None = None,
        latched: bool = False,
    ) -> int:
        """
        Write a message that is encoded as CDR; writes the chunk where it is full.

        topic : absolute name, or one relative to the namespace
        msgtype : such as 'sensor_msgs/msg/PointCloud2'
        definition : text in ros2msg format; needed for types that are not in ROS 2 Jazzy
        latched : the topic's publisher is transient local
        :returns: index of the message in its topic, from 0
        :raises FileError: the file cannot be written, the type is unknown, or the topic has
            messages of another type
        """
        name = topic if topic.startswith('/') else f'{self._namespace}/{topic}'
        with self._named_errors():
            opened = self._topics.get(name) or self._open_topic(name, msgtype, definition, latched)
            if opened.metadata.msgtype != msgtype:
                raise FileError(
                    f'{self._label}: {name}: holds {opened.metadata.msgtype}, not {msgtype}'
                )
            index = opened.following
            self._mcap.add_message(opened.id, stamp_ns, data, index)
        opened.count += 1
        opened.following += 1
        self.pending_bytes += len(data)
        self._pending_messages += 1
        start, end = self._span_ns or (stamp_ns, stamp_ns)
        self._span_ns = min(start, stamp_ns), max(end, stamp_ns)
        if self._chunk_bytes is not None and self.pending_bytes >= self._chunk_bytes:
            self.flush()
        return index

    def flush(self) -> int | None:
        """
        Write the messages since the last chunk as a chunk.

        :returns: offset of the chunk in the file, bytes; None where there are no messages
        :raises FileError: the file cannot be written
        """
        if not self._pending_messages:
            return None
        with self._named_errors():
            offset = self._mcap.flush()
        self.pending_bytes = self._pending_messages = 0
        return offset

    def sync(self) -> None:
        """
        Wait until the chunks that were written are on the disk, where a power cut spares them.

        :raises FileError: the file cannot be written
        """
        with self._named_errors():
            os.fdatasync(self._stream.fileno())

    def finish(self) -> Path:
        """
        Write the index and ``metadata.yaml``, and rename the file to ``scan.mcap``.

        :raises FileError: a file cannot be written; the bag stays ``scan.mcap.part``
        """
        self.flush()
        topics = [
            metadata.TopicMetadata(**{**vars(opened.metadata), 'count': opened.count})
            for opened in self._topics.values()
        ]
        start_ns, end_ns = self._span_ns or (0, 0)
        count = sum(topic.count for topic in topics)
        file = metadata.FileMetadata(name=FILE_NAME, start_ns=start_ns, end_ns=end_ns, count=count)
        info = metadata.bag_information([file], topics)
        path = self.folder / FILE_NAME
        with self._named_errors():
            # rosbag2 reads a file without its folder by this record
            self._mcap.add_metadata('rosbag2', {'serialized_metadata': metadata.dump(info)})
            self._mcap.finish()
            # on the disk before the rename: a complete name means complete content
            os.fsync(self._stream.fileno())
            self._stream.close()
            (self.folder / PART_NAME).rename(path)
            document = metadata.dump({'rosbag2_bagfile_information': info})
            write_text(self.folder / metadata.FILE_NAME, document)
        return path

    def close(self) -> None:
        """Close the file; what was not flushed is lost unless ``finish`` was called."""
        self._stream.close()

    def _write_message(self, name: str, stamp_ns: int, message: Any) -> None:
        data = cdr.encode(message)
        self.write(name, message.__msgtype__, data, stamp_ns, latched=name in _LATCHED)

    def _open_file(self) -> IO[bytes]:
        complete = self.folder / FILE_NAME
        if complete.exists():
            raise FileError(f'{complete}: exists already and is not overwritten')
        path = self.folder / PART_NAME
        with self._named_errors():
            try:
                # mode x: a bag that was cut off by a crash holds a scan as well
                stream = path.open('xb')
            except FileExistsError:
                raise FileError(f'{path}: exists already and is not overwritten') from None
            # a repair must not take the recording away; some file systems have no locks
            with suppress(OSError):
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return stream

    def _reopen_file(self, visit: Visit) -> tuple[IO[bytes], WrittenPart]:
        """Open the bag of an interrupted recording, and cut off what follows its last chunk."""
        path, complete = self.folder / PART_NAME, self.folder / FILE_NAME
        if path.exists() and complete.exists():
            raise FileError(
                f'{self.folder}: has both {FILE_NAME} and {PART_NAME}: the recording was '
                f'repaired; move {PART_NAME} elsewhere to go on with the repaired one'
            )
        source = path if path.exists() else complete
        if not source.is_file():
            raise FileError(f'{source}: there is no bag to go on with')
        with self._named_errors():
            stream = source.open('r+b')
            try:
                _lock(stream, source)
                written = read_written_part(source, visit)
                if source == complete:
                    # it says how many messages the bag has
                    (self.folder / metadata.FILE_NAME).unlink(missing_ok=True)
                    complete.rename(path)
                stream.truncate(written.end)
                stream.seek(written.end)
            except BaseException:
                stream.close()
                raise
        return stream, written

    def _take_over(self, written: WrittenPart) -> None:
        """Know the topics and messages that the bag has."""
        names = {schema.id: schema.name for schema in written.schemas}
        for schema in written.schemas:
            self._schemas[schema.name, schema.data.decode('utf-8', 'replace')] = schema.id
        for channel in written.channels:
            described = metadata.TopicMetadata(
                topic=channel.topic,
                msgtype=names[channel.schema_id],
                type_hash=channel.metadata.get('topic_type_hash', ''),
                qos=channel.metadata.get('offered_qos_profiles', ''),
            )
            self._topics[channel.topic] = _OpenTopic(
                id=channel.id,
                metadata=described,
                count=written.counts[channel.id],
                following=written.following.get(channel.id, 0),
            )
        self.kept_messages, self.kept_bytes = written.counts.total(), written.message_bytes
        self._span_ns = written.span_ns if written.chunk_indices else None

    def _open_topic(
        self, topic: str, msgtype: str, definition: str | None, latched: bool
    ) -> _OpenTopic:
        is_known = definition is None
        if is_known and not cdr.knows(msgtype):
            raise FileError(f'{self._label}: {topic}: no definition of {msgtype} is known')
        described = metadata.TopicMetadata(
            topic=topic,
            msgtype=msgtype,
            type_hash=cdr.type_hash(msgtype) if is_known else '',
            latched=latched,
        )
        channel = self._mcap.add_channel(
            topic,
            cdr.ENCODING,
            self._schema(msgtype, cdr.definition(msgtype) if definition is None else definition),
            {
                'offered_qos_profiles': metadata.dump(metadata.offered_qos_profiles(described)),
                'topic_type_hash': described.type_hash,
            },
        )
        self._topics[topic] = _OpenTopic(id=channel, metadata=described)
        return self._topics[topic]

    def _schema(self, msgtype: str, text: str) -> int:
        key = msgtype, text
        if key not in self._schemas:
            self._schemas[key] = self._mcap.add_schema(msgtype, text.encode())
        return self._schemas[key]

    @contextmanager
    def _named_errors(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise FileError(
                f'{self._label}: cannot be written: {error.strerror or error}'
            ) from error


def _lock(stream: IO[bytes], path: Path) -> None:
    """:raises FileError: the recorder of a file still runs."""
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise FileError(f'{path}: is being recorded; stop the recorder first') from None
    except OSError:
        # the file system has no locks
        return


@contextmanager
def create_bag(
    folder: Path, *, namespace: str = NAMESPACE, compress: bool = True
) -> Iterator[BagWriter]:
    """
    Create a bag folder; yields its writer.

    The folder appears when the block ends. If the block raises, nothing remains.

    folder : must not exist, or be empty
    namespace, compress : as in ``BagWriter``
    :raises FileError: the folder is not empty, or cannot be written
    """
    with atomic_folder(folder) as temporary:
        bag = BagWriter(temporary, namespace=namespace, compress=compress, label=str(folder))
        try:
            yield bag
            bag.finish()
        finally:
            bag.close()
