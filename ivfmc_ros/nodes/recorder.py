# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Executable ``recorder``: the topics of a running scan to an MCAP bag and to the catalogue.

Messages are written as received, without deserialization; only profiles are deserialized, for
their catalogue rows. ``recorded`` publishes the number of the last profile that is on disk.
"""

from collections.abc import Mapping
from collections.abc import Sequence
from functools import partial
from pathlib import Path
import sys
from typing import Any

from geometry_msgs.msg import PoseArray
from rclpy.qos import DurabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import CameraInfo
from sensor_msgs.msg import CompressedImage
from sensor_msgs.msg import Image
from sensor_msgs.msg import JointState
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import Mesh
from std_msgs.msg import Header
from std_msgs.msg import UInt64
from visualization_msgs.msg import Marker

from ivfmc_ros.errors import BusyError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.errors import StateError
from ivfmc_ros.files import folder_below
from ivfmc_ros.nodes.framework import qos
from ivfmc_ros.nodes.framework.adaptive_subscription import AdaptiveSubscription
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.base import run
from ivfmc_ros.nodes.framework.health import Level
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.catalogue.catalogue_writer import CatalogueWriter
from ivfmc_ros.storage.messages.profile_header import ProfileHeader
from ivfmc_ros.storage.messages.profile_header import read_profile_header
from ivfmc_ros.storage.recording.live_recorder import LiveRecorder
from ivfmc_ros.storage.recording.live_recorder import ProfileLocation

TYPES = {
    'image_raw': Image,
    'image_raw/compressed': CompressedImage,
    'camera_info': CameraInfo,
    'joint_states': JointState,
    'laser_states': JointState,
    'profile': PointCloud2,
    'view': PointCloud2,
    'view_poses': PoseArray,
    'cloud': PointCloud2,
    'mesh': Marker,
    'mesh_shape': Mesh,
}
_CAMERA_TOPICS = ('image_raw', 'image_raw/compressed', 'camera_info')
# Period of ``recorded``, seconds: the orchestrator waits for it after the last profile.
_PUBLISH_S = 0.05
# Seconds between two checks of the heartbeat of the orchestrator.
_POLL_S = 0.5
# Kinds of conditions.
_DROPPED = 'messages dropped'
_NOT_WRITTEN = 'not written'
_SILENT = 'no heartbeat'


class Recorder(CellNode):
    """Subscribes to its topics at all times and writes them between ``start`` and ``stop``."""

    def __init__(self) -> None:
        super().__init__('recorder')
        self.parameter('scan_id', '', 'Id of the scan, for the catalogue.')
        self.parameter(
            'scan_root', 'scans', 'Folder of all scans; scan_folder is below it.', read_only=True
        )
        self.parameter(
            'scan_folder',
            '',
            'Folder of the scan, below scan_root or relative to it; the catalogue is in its '
            'parent folder.',
        )
        self.parameter(
            'topics',
            [name for name in TYPES if name != 'image_raw/compressed'],
            'Names of the recorded topics; read at the start of the node.',
            constraints=f'some of {", ".join(TYPES)}',
        )
        self.parameter(
            'pictures', True, 'Record images; the orchestrator clears it after the last profile.'
        )
        self.parameter(
            'compress',
            True,
            'Compress chunks with zstd: less to write, more to compute.',
        )
        self.parameter(
            'room',
            256,
            'Megabytes of the write queue; messages beyond are dropped and counted.',
            low=16,
            high=65536,
        )
        self.parameter(
            'orchestrator_patience',
            30.0,
            'Seconds without a heartbeat of the orchestrator after which the recording stops; '
            '0: never.',
            low=0.0,
            high=3600.0,
        )
        self.check(self._require_scan_folder)
        self._recorder: LiveRecorder | None = None
        self._orchestrator_heard_s: float | None = None
        self._catalogue_writer: CatalogueWriter | None = None
        self._published: int | None = None
        self._recorded = self.publish_on(UInt64, 'recorded')
        self._recorded_topics = [self._subscribe(name) for name in self.get('topics')]
        self.trigger('start', self._start)
        self.trigger('stop', self._stop)
        self.subscribe(Header, 'orchestrator/heartbeat', self._receive_heartbeat)
        self.steady_timer(_PUBLISH_S, self._publish_progress)
        self.steady_timer(_POLL_S, self._check_orchestrator)

    def stop(self) -> None:
        """Finish the bag, so that it can be read."""
        if self._recorder is not None:
            recorder, self._recorder = self._recorder, None
            self._finish(recorder)
        super().stop()

    def before_diagnosis(self) -> None:
        """Publish how much has been written, and the errors of bag and catalogue."""
        recorder = self._recorder
        if recorder is None:
            self.status('idle')
            return
        counts = recorder.counts
        if recorder.error is not None:
            self.health.set(_NOT_WRITTEN, 'bag', Level.ERROR, recorder.error)
        if counts.dropped:
            dropped = ', '.join(f'{n} on {name}' for name, n in counts.dropped_topics.items())
            text = f'the disk is too slow; dropped messages: {dropped}'
            self.health.set(_DROPPED, 'bag', Level.ERROR, text)
        writer = self._catalogue_writer
        if writer is not None and writer.error:
            self.health.set(_NOT_WRITTEN, 'catalogue', Level.ERROR, writer.error)
        else:
            self.health.clear(_NOT_WRITTEN, 'catalogue')
        self.status(
            'recording',
            messages=counts.messages,
            bytes=counts.bytes,
            waiting=recorder.queued_bytes,
        )

    def _require_scan_folder(self, values: Mapping[str, Any]) -> None:
        """:raises ParameterError: the folder is not below ``scan_root``."""
        if values.get('scan_folder'):
            folder_below(Path(values['scan_root']), values['scan_folder'], 'scan_folder')

    def _subscribe(self, name: str) -> Any:
        if name not in TYPES:
            known = ', '.join(TYPES)
            raise ParameterError(f'recorder: topics: {name!r} is not one of {known}')
        return AdaptiveSubscription(
            self, TYPES[name], name, partial(self._receive, name), raw=True
        )

    def _receive(self, name: str, data: bytes) -> None:
        recorder = self._recorder
        if recorder is None or (name in _CAMERA_TOPICS and not self.get('pictures')):
            return
        kind = TYPES[name]
        package = kind.__module__.partition('.')[0]
        header = _profile_header(data) if name == 'profile' else None
        recorder.add(
            self.resolve_topic_name(name),
            f'{package}/msg/{kind.__name__}',
            data,
            self.now_ns(),
            latched=qos.of_topic(name).durability is DurabilityPolicy.TRANSIENT_LOCAL,
            header=header,
        )

    def _start(self) -> dict[str, Any]:
        if self._recorder is not None:
            raise BusyError(f'recorder: already records {self._recorder.folder}')
        folder, scan_id = self.get('scan_folder'), self.get('scan_id')
        if not folder or not scan_id:
            raise ParameterError('recorder: scan_folder and scan_id must be set before start')
        # again: a link may have been made since the parameter was set
        folder = str(folder_below(Path(self.get('scan_root')), folder, 'scan_folder'))
        self._published = self._orchestrator_heard_s = None
        for kind, subject in (
            (_DROPPED, 'bag'),
            (_NOT_WRITTEN, 'bag'),
            (_NOT_WRITTEN, 'catalogue'),
            (_SILENT, 'orchestrator'),
        ):
            self.health.clear(kind, subject)
        self.health.clear_fault('bag')
        writer = CatalogueWriter(Catalogue(Path(folder).parent, create=True))
        try:
            self._recorder = LiveRecorder(
                Path(folder),
                compress=self.get('compress'),
                max_queued_bytes=self.get('room') * 1024 * 1024,
                on_flush=lambda locations: writer.add(partial(_add_profiles, scan_id, locations)),
            )
        except ScanError:
            writer.close()
            raise
        self._catalogue_writer = writer
        return {'path': str(self._recorder.folder), 'topics': list(self.get('topics'))}

    def _finish(self, recorder: LiveRecorder) -> Path:
        """Write the rest of bag and catalogue; blocks until both are on disk."""
        try:
            return recorder.stop()
        finally:
            if self._catalogue_writer is not None:
                self._catalogue_writer.close()

    async def _stop(self) -> dict[str, Any]:
        recorder, self._recorder = self._recorder, None
        if recorder is None:
            raise StateError('recorder: no recording is running')
        path = await self.in_thread(self._finish, recorder)
        self._publish(recorder)
        counts, writer = recorder.counts, self._catalogue_writer
        return {
            'path': str(path),
            'messages': counts.messages,
            'bytes': counts.bytes,
            'dropped': counts.dropped,
            'recorded': recorder.recorded,
            'catalogue_error': writer.error if writer is not None else '',
        }

    def _receive_heartbeat(self, _: Header) -> None:
        self._orchestrator_heard_s = self.steady_s()

    def _check_orchestrator(self) -> None:
        """Stop the recording of an orchestrator that died: images would fill the disk."""
        patience = self.get('orchestrator_patience')
        if self._recorder is None or self._orchestrator_heard_s is None or not patience:
            return
        silent = self.steady_s() - self._orchestrator_heard_s
        if silent > patience:
            text = f'no heartbeat for {silent:.0f} s; the recording was stopped'
            self.health.set(_SILENT, 'orchestrator', Level.ERROR, text)
            self.executor.create_task(self._stop_recording)

    async def _stop_recording(self) -> None:
        try:
            await self._stop()
        except StateError:
            # stopped by the service in the meantime
            return
        except ScanError as error:
            self.fault('bag', error)

    def _publish_progress(self) -> None:
        if self._recorder is not None:
            self._publish(self._recorder)

    def _publish(self, recorder: LiveRecorder) -> None:
        if recorder.recorded is not None and recorder.recorded != self._published:
            self._published = recorder.recorded
            self._recorded.publish(UInt64(data=recorder.recorded))


def _profile_header(data: bytes) -> ProfileHeader:
    return read_profile_header(deserialize_message(data, PointCloud2))


def _add_profiles(
    scan_id: str, locations: Sequence[ProfileLocation], catalogue: Catalogue
) -> None:
    catalogue.add_profiles(scan_id, locations)


def main() -> None:
    """Run the node."""
    sys.exit(run(Recorder))


if __name__ == '__main__':
    main()
