# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writes a scan as a bag that ``ros2 bag play`` takes; it appears whole or not at all."""

from collections.abc import Iterator
from collections.abc import Mapping
from contextlib import contextmanager
from contextlib import ExitStack
from dataclasses import dataclass
from dataclasses import replace
import os
from pathlib import Path
from types import TracebackType
from typing import Any
from typing import IO
from typing import Self

from mcap.writer import CompressionType
from mcap.writer import Writer

from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.errors import FileError
from ivfmc_ros.files import whole_folder
from ivfmc_ros.model import Image
from ivfmc_ros.storage.bag import metadata
from ivfmc_ros.storage.messages import build
from ivfmc_ros.storage.messages import cdr

FILE_NAME = 'scan.mcap'
NAMESPACE = '/ivfmc'

# transient local in design: what comes late must know which laser is on
_LATCHED = ('laser_states',)


@dataclass(frozen=True, kw_only=True)
class _Open:
    """What is known of a topic while its bag is being written."""

    channel: metadata.Channel
    id: int


class BagWriter:
    """
    A bag folder in the making: ``scan.mcap`` and ``metadata.yaml``.

    Used in a ``with`` block. The folder appears when the block ends; if it raises, nothing
    remains. Every message is logged at the stamp that it is given, in nanoseconds.
    """

    def __init__(self, folder: Path, *, namespace: str = NAMESPACE, compress: bool = True) -> None:
        """
        Prepare to write ``folder``, which must be new or empty.

        compress : zstd per chunk; without it a 1.3 MB picture takes 2 ms instead of up to 12
        """
        self.folder = folder
        self._namespace = namespace.rstrip('/')
        self._compression = CompressionType.ZSTD if compress else CompressionType.NONE
        self._topics: dict[str, _Open] = {}
        self._schemas: dict[tuple[str, str], int] = {}
        self._span_ns: tuple[int, int] | None = None
        self._temporary = Path()
        self._cleanup = ExitStack()
        self._file: IO[bytes] | None = None
        self._mcap: Any = None

    def __enter__(self) -> Self:
        """:raises FileError: the folder exists and is not empty, or cannot be written."""
        with self._named(), ExitStack() as cleanup:
            self._temporary = cleanup.enter_context(whole_folder(self.folder))
            self._file = cleanup.enter_context((self._temporary / FILE_NAME).open('wb'))
            # the chunks' checksums are the default; this one covers what lies between them
            self._mcap = Writer(self._file, compression=self._compression, enable_data_crcs=True)
            self._mcap.start(profile='ros2', library='ivfmc_ros')
            self._cleanup = cleanup.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is not None:
            self._cleanup.__exit__(kind, error, trace)
            return
        with self._cleanup:
            self._finish()

    def image(self, stamp_ns: int, image: Image) -> None:
        """Write a picture, (height, width) mono or (height, width, 3) BGR, on ``image_raw``."""
        self._write('image_raw', stamp_ns, build.image(stamp_ns, image))

    def compressed_image(self, stamp_ns: int, data: bytes, format: str) -> None:
        """Write a picture file as it is, 'jpeg' or 'png', on ``image_raw/compressed``."""
        message = build.compressed_image(stamp_ns, data, format)
        self._write('image_raw/compressed', stamp_ns, message)

    def camera_info(self, stamp_ns: int, camera: Camera) -> None:
        """Write the camera's calibration on ``camera_info``."""
        self._write('camera_info', stamp_ns, build.camera_info(stamp_ns, camera))

    def joint_state(
        self, stamp_ns: int, name: str, position: float, velocity: float | None = None
    ) -> None:
        """Write where the table is, radians and radians per second, on ``joint_states``."""
        message = build.joint_state(stamp_ns, {name: position}, velocity)
        self._write('joint_states', stamp_ns, message)

    def laser_state(self, stamp_ns: int, lit: Mapping[str, bool]) -> None:
        """Write which lasers are on, by name, on ``laser_states``."""
        positions = {name: float(on) for name, on in lit.items()}
        self._write('laser_states', stamp_ns, build.joint_state(stamp_ns, positions))

    def raw(
        self,
        topic: str,
        msgtype: str,
        data: bytes,
        stamp_ns: int,
        *,
        definition: str | None = None,
        latched: bool = False,
    ) -> None:
        """
        Write a message that is CDR already.

        topic : its full name, or one that is put under the namespace
        msgtype : such as 'sensor_msgs/msg/PointCloud2'
        definition : ros2msg text, for types that are not among those of Jazzy
        :raises FileError: it cannot be written
        """
        topic = topic if topic.startswith('/') else f'{self._namespace}/{topic}'
        with self._named():
            opened = self._topics.get(topic) or self._open(topic, msgtype, definition, latched)
            if opened.channel.msgtype != msgtype:
                known = opened.channel.msgtype
                raise FileError(f'{self.folder}: {topic}: holds {known}, not {msgtype}')
            count = opened.channel.count
            self._mcap.add_message(opened.id, stamp_ns, data, stamp_ns, sequence=count)
        self._topics[topic] = replace(opened, channel=replace(opened.channel, count=count + 1))
        start, end = self._span_ns or (stamp_ns, stamp_ns)
        self._span_ns = min(start, stamp_ns), max(end, stamp_ns)

    def _write(self, name: str, stamp_ns: int, message: Any) -> None:
        data = cdr.encode(message)
        self.raw(name, message.__msgtype__, data, stamp_ns, latched=name in _LATCHED)

    def _open(self, topic: str, msgtype: str, definition: str | None, latched: bool) -> _Open:
        if definition is None and not cdr.knows(msgtype):
            raise FileError(f'{self.folder}: {topic}: no definition of {msgtype} is known')
        known = definition is None
        channel = metadata.Channel(
            topic=topic,
            msgtype=msgtype,
            type_hash=cdr.type_hash(msgtype) if known else '',
            latched=latched,
        )
        text = cdr.definition(msgtype) if definition is None else definition
        channel_id = self._mcap.register_channel(
            topic,
            cdr.ENCODING,
            self._schema(msgtype, text),
            {
                'offered_qos_profiles': metadata.dump(metadata.qos(channel)),
                'topic_type_hash': channel.type_hash,
            },
        )
        return _Open(channel=channel, id=channel_id)

    def _schema(self, msgtype: str, text: str) -> int:
        key = msgtype, text
        if key not in self._schemas:
            self._schemas[key] = self._mcap.register_schema(msgtype, 'ros2msg', text.encode())
        return self._schemas[key]

    def _finish(self) -> None:
        channels = [opened.channel for opened in self._topics.values()]
        info = metadata.information(FILE_NAME, channels, *(self._span_ns or (0, 0)))
        with self._named():
            # the file can be played without its folder, as one that rosbag2 wrote
            self._mcap.add_metadata('rosbag2', {'serialized_metadata': metadata.dump(info)})
            self._mcap.finish()
            self._close()
            document = metadata.dump({'rosbag2_bagfile_information': info})
            (self._temporary / metadata.FILE_NAME).write_text(document, encoding='utf-8')

    def _close(self) -> None:
        # on the disk before it gets its name: what has a name is whole, also after a power cut
        if self._file is not None:
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.close()

    @contextmanager
    def _named(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise FileError(
                f'{self.folder}: cannot be written: {error.strerror or error}'
            ) from error
