# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
``recorder``: the bag of a scan as it runs, and the catalogue's rows of its profiles and views.

Messages are written as they come off the wire; only profiles are looked into, for the catalogue.
"""

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
from ivfmc_ros.nodes.framework import qos
from ivfmc_ros.nodes.framework.adaptive_subscription import AdaptiveSubscription
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.base import run
from ivfmc_ros.nodes.framework.health import Level
from ivfmc_ros.storage.catalogue import Catalogue
from ivfmc_ros.storage.catalogue_writer import Notes
from ivfmc_ros.storage.live_recorder import LiveRecorder
from ivfmc_ros.storage.live_recorder import Place
from ivfmc_ros.storage.messages.profile_head import ProfileHead
from ivfmc_ros.storage.messages.profile_head import read_head

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
_OF_CAMERA = ('image_raw', 'image_raw/compressed', 'camera_info')
_PUBLISH_S = 0.05
_LOOK_S = 0.5


class Recorder(CellNode):
    """Listens all the time, so that nothing is missed at the start, and writes during a scan."""

    def __init__(self) -> None:
        super().__init__('recorder')
        self.parameter('scan_id', '', 'Id of the scan, for the catalogue.')
        self.parameter(
            'scan_folder', '', 'Folder of the scan; the catalogue is in the one above it.'
        )
        self.parameter(
            'topics',
            [name for name in TYPES if name != 'image_raw/compressed'],
            'Names of the topics that are recorded; taken at the start of the node.',
            constraints=f'some of {", ".join(TYPES)}',
        )
        self.parameter(
            'pictures', True, 'Record pictures; the orchestrator ends it with the last profile.'
        )
        self.parameter(
            'compress', True, 'Compress chunks by zstd; without it the disk has more to take.'
        )
        self.parameter(
            'room',
            256,
            'Megabytes that may wait for the disk; what comes beyond is dropped and counted.',
            low=16,
            high=65536,
        )
        self.parameter(
            'orchestrator_patience',
            30.0,
            'Seconds without a heartbeat of the orchestrator after which its recording is ended; '
            '0: never.',
            low=0.0,
            high=3600.0,
        )
        self._recorder: LiveRecorder | None = None
        self._led_s: float | None = None
        self._notes: Notes | None = None
        self._told: int | None = None
        self._recorded = self.publish_on(UInt64, 'recorded')
        self._listening = [self._listen(name) for name in self.get('topics')]
        self.trigger('start', self._start)
        self.trigger('stop', self._stop)
        self.subscribe(Header, 'orchestrator/heartbeat', self._hear_orchestrator)
        self.steady_timer(_PUBLISH_S, self._tell)
        self.steady_timer(_LOOK_S, self._look)

    def stop(self) -> None:
        """End the bag, so that it can be read."""
        if self._recorder is not None:
            recorder, self._recorder = self._recorder, None
            self._end(recorder)
        super().stop()

    def before_diagnosis(self) -> None:
        """Say how much has been written, and what is going wrong."""
        recorder = self._recorder
        if recorder is None:
            self.status(Level.OK, 'idle')
            return
        counts = recorder.counts
        if recorder.error is not None:
            self.health.set('file', Level.ERROR, recorder.error)
        if counts.dropped:
            lost = ', '.join(f'{n} on {name}' for name, n in counts.dropped_topics.items())
            self.health.set('disk', Level.ERROR, f'too slow, dropped messages: {lost}')
        late = self._notes.error if self._notes is not None else ''
        self.health.set('catalogue', Level.ERROR if late else Level.OK, late)
        self.status(
            Level.OK,
            'recording',
            messages=counts.messages,
            bytes=counts.bytes,
            waiting=recorder.waiting,
        )

    def _listen(self, name: str) -> Any:
        if name not in TYPES:
            known = ', '.join(TYPES)
            raise ParameterError(f'recorder: topics: {name!r} is not one of {known}')
        return AdaptiveSubscription(self, TYPES[name], name, partial(self._take, name), raw=True)

    def _take(self, name: str, data: bytes) -> None:
        recorder = self._recorder
        if recorder is None or (name in _OF_CAMERA and not self.get('pictures')):
            return
        kind = TYPES[name]
        package = kind.__module__.partition('.')[0]
        mark = self._mark(data) if name == 'profile' else None
        recorder.add(
            self.resolve_topic_name(name),
            f'{package}/msg/{kind.__name__}',
            data,
            self.now_ns(),
            latched=qos.of_topic(name).durability is DurabilityPolicy.TRANSIENT_LOCAL,
            mark=mark,
        )

    def _mark(self, data: bytes) -> ProfileHead:
        return read_head(deserialize_message(data, PointCloud2))

    def _start(self) -> dict[str, Any]:
        if self._recorder is not None:
            raise BusyError(f'recorder: is recording {self._recorder.folder}')
        folder, scan_id = self.get('scan_folder'), self.get('scan_id')
        if not folder or not scan_id:
            raise ParameterError('recorder: scan_folder and scan_id must be set before start')
        self._told = self._led_s = None
        for trouble in ('disk', 'catalogue', 'file', 'orchestrator'):
            self.health.clear(trouble)
        notes = Notes(Catalogue(Path(folder).parent, create=True))
        try:
            self._recorder = LiveRecorder(
                Path(folder),
                compress=self.get('compress'),
                room=self.get('room') * 1024 * 1024,
                flushed=lambda places: notes.add(partial(_note, scan_id, places)),
            )
        except ScanError:
            notes.close()
            raise
        self._notes = notes
        return {'path': str(self._recorder.folder), 'topics': list(self.get('topics'))}

    def _end(self, recorder: LiveRecorder) -> Path:
        """Write what is left of bag and catalogue; waits for both."""
        try:
            return recorder.stop()
        finally:
            if self._notes is not None:
                self._notes.close()

    async def _stop(self) -> dict[str, Any]:
        recorder, self._recorder = self._recorder, None
        if recorder is None:
            raise StateError('recorder: nothing is being recorded')
        path = await self.in_thread(self._end, recorder)
        self._publish(recorder)
        counts = recorder.counts
        return {
            'path': str(path),
            'messages': counts.messages,
            'bytes': counts.bytes,
            'dropped': counts.dropped,
            'recorded': recorder.recorded,
            'catalogue_error': self._notes.error if self._notes is not None else '',
        }

    def _hear_orchestrator(self, _: Header) -> None:
        self._led_s = self.steady_s()

    def _look(self) -> None:
        """End what nobody else will: pictures without end fill the disk."""
        patience = self.get('orchestrator_patience')
        if self._recorder is None or self._led_s is None or not patience:
            return
        silent = self.steady_s() - self._led_s
        if silent > patience:
            text = f'silent for {silent:.0f} s; the recording was ended'
            self.health.set('orchestrator', Level.ERROR, text)
            self.executor.create_task(self._stop_alone)

    async def _stop_alone(self) -> None:
        try:
            await self._stop()
        except StateError:
            # somebody was faster
            return
        except ScanError as error:
            self.trouble('file', error)

    def _tell(self) -> None:
        if self._recorder is not None:
            self._publish(self._recorder)

    def _publish(self, recorder: LiveRecorder) -> None:
        if recorder.recorded is not None and recorder.recorded != self._told:
            self._told = recorder.recorded
            self._recorded.publish(UInt64(data=recorder.recorded))


def _note(scan_id: str, places: Sequence[Place], catalogue: Catalogue) -> None:
    catalogue.add_profiles(scan_id, places)


def main() -> None:
    """Run the node."""
    sys.exit(run(Recorder))


if __name__ == '__main__':
    main()
