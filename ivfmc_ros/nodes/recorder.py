# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Executable ``recorder``: the topics of a running scan to an MCAP bag and to the catalogue.

Messages are written as received, without deserialization; only profiles are deserialized, for
their catalogue rows. ``recorded`` publishes the number of the last profile that is on disk.
"""

from collections.abc import Mapping
import contextlib
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
from std_msgs.msg import String
from std_msgs.msg import UInt64
from visualization_msgs.msg import Marker

from ivfmc_ros.errors import BusyError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.errors import StateError
from ivfmc_ros.errors import TimeoutExceededError
from ivfmc_ros.files import folder_below
from ivfmc_ros.nodes.framework import qos
from ivfmc_ros.nodes.framework.adaptive_subscription import AdaptiveSubscription
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.base import run
from ivfmc_ros.nodes.framework.futures import Waiter
from ivfmc_ros.nodes.framework.health import Level
from ivfmc_ros.nodes.framework.life import life_of
from ivfmc_ros.nodes.processing.cell_frames import TF
from ivfmc_ros.nodes.processing.cell_frames import tf_message_type
from ivfmc_ros.nodes.processing.cell_frames import TF_STATIC
from ivfmc_ros.nodes.processing.recording import Recording
from ivfmc_ros.storage.messages.profile_header import ProfileHeader
from ivfmc_ros.storage.messages.profile_header import read_profile_header

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
    'robot_description': String,
    # None where tf2_msgs is not installed: there is nothing to record then
    TF: tf_message_type(),
    TF_STATIC: tf_message_type(),
}
_CAMERA_TOPICS = ('image_raw', 'image_raw/compressed', 'camera_info')
# Topics with many messages in an idle cell, and those of the cell itself, whose last message a new
# subscription receives; subscribed only while a scan is recorded. The latched ones of a scan are
# subscribed at all times: a new subscription would receive those of the scan before.
_STREAMS = (*_CAMERA_TOPICS, 'joint_states', 'robot_description', TF, TF_STATIC)
# Seconds that ``start`` waits at most for the first message of each stream that has a publisher.
_FIRST_MESSAGES_S = 1.0
# Period of ``recorded``, seconds: the orchestrator waits for it after the last profile.
_PUBLISH_S = 0.05
# Seconds between two checks of the heartbeat of the orchestrator.
_POLL_S = 0.5
# Seconds of silence of the owner after which another orchestrator has replaced it.
_REPLACED_S = 2.0
# Seconds to wait at the end of the node for a recording that is being closed.
_CLOSE_S = 15.0
# Kinds of conditions.
_DROPPED = 'messages dropped'
_NOT_WRITTEN = 'not written'
_SILENT = 'no heartbeat'


class Recorder(CellNode):
    """Writes its topics between ``start`` and ``stop``; streams are subscribed only then."""

    def __init__(self) -> None:
        super().__init__('recorder')
        self._declare_parameters()
        self.check(self._require_scan_folder)
        self._recording: Recording | None = None
        # id of the scan whose bag is being opened
        self._opening = ''
        # recordings that are being closed, each with its own bag and catalogue
        self._closing: list[Recording] = []
        self._recorded = self.publish_on(UInt64, 'recorded')
        self._waiter = Waiter(self)
        # streams of which a message was received since they were subscribed
        self._heard: set[str] = set()
        subscribed = ((name, self._subscribe(name)) for name in self.get('topics'))
        self._recorded_topics = {name: found for name, found in subscribed if found is not None}
        self.changed(self._change)
        self.trigger('start', self._start)
        self.trigger('stop', self._stop)
        self.subscribe(Header, 'orchestrator/heartbeat', self._receive_heartbeat)
        self._timers_of_a_recording = [
            self.steady_timer(_PUBLISH_S, self._publish_progress),
            self.steady_timer(_POLL_S, self._check_orchestrator),
        ]
        self._follow_streams()

    def _declare_parameters(self) -> None:
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
            'first_profile',
            0,
            'Number of profiles that the bag of an interrupted scan has, behind which start goes '
            'on; 0: a new bag.',
            low=0,
            high=10_000_000,
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
        self.parameter(
            'owner',
            '',
            'Life of the orchestrator whose recording begins, as in its heartbeat; empty: the '
            'one that is heard first.',
        )

    def stop(self) -> None:
        """Finish the bag, so that it can be read."""
        recording, self._recording = self._recording, None
        if recording is not None:
            recording.finish()
        for closing in self._closing:
            closing.finished.wait(_CLOSE_S)
        super().stop()

    def before_diagnosis(self) -> None:
        """Publish how much has been written, and the errors of bag and catalogue."""
        recording = self._recording
        if recording is None:
            self.status('idle', closing=len(self._closing))
            return
        recorder, writer = recording.recorder, recording.writer
        counts = recorder.counts
        if recorder.error is not None:
            self.health.set(_NOT_WRITTEN, 'bag', Level.ERROR, recorder.error)
        if counts.dropped:
            dropped = ', '.join(f'{n} on {name}' for name, n in counts.dropped_topics.items())
            text = f'the disk is too slow; dropped messages: {dropped}'
            self.health.set(_DROPPED, 'bag', Level.ERROR, text)
        if writer.error:
            self.health.set(_NOT_WRITTEN, 'catalogue', Level.ERROR, writer.error)
        else:
            self.health.clear(_NOT_WRITTEN, 'catalogue')
        self.status(
            'recording',
            scan_id=recording.scan_id,
            messages=counts.messages,
            bytes=counts.bytes,
            waiting=recorder.queued_bytes,
            closing=len(self._closing),
        )

    def _require_scan_folder(self, values: Mapping[str, Any]) -> None:
        """:raises ParameterError: the folder is not below ``scan_root``."""
        if values.get('scan_folder'):
            folder_below(Path(values['scan_root']), values['scan_folder'], 'scan_folder')

    def _subscribe(self, name: str) -> Any:
        if name not in TYPES:
            known = ', '.join(TYPES)
            raise ParameterError(f'recorder: topics: {name!r} is not one of {known}')
        if TYPES[name] is None:
            return None
        return AdaptiveSubscription(
            self, TYPES[name], name, partial(self._receive, name), raw=True
        )

    def _change(self, names: set[str]) -> None:
        if 'pictures' in names:
            self._follow_streams()

    def _follow_streams(self) -> None:
        """Subscribe to the streams that are recorded now, and to no other."""
        is_recording = self._recording is not None
        for name in _STREAMS:
            subscription = self._recorded_topics.get(name)
            if subscription is None:
                continue
            if is_recording and (name not in _CAMERA_TOPICS or self.get('pictures')):
                subscription.resume()
            else:
                subscription.pause()
                self._heard.discard(name)
        for timer in self._timers_of_a_recording:
            if not is_recording:
                timer.cancel()
            elif timer.is_canceled():
                timer.reset()

    def _hears_streams(self) -> bool:
        return all(
            subscription.is_paused or name in self._heard or not subscription.publishers
            for name, subscription in self._recorded_topics.items()
            if name in _STREAMS
        )

    def _receive(self, name: str, data: bytes) -> None:
        self._heard.add(name)
        recording = self._recording
        if recording is None or (name in _CAMERA_TOPICS and not self.get('pictures')):
            return
        kind = TYPES[name]
        package = kind.__module__.partition('.')[0]
        header = _profile_header(data) if name == 'profile' else None
        recording.recorder.add(
            self.resolve_topic_name(name),
            f'{package}/msg/{kind.__name__}',
            data,
            self.now_ns(),
            latched=qos.of_topic(name).durability is DurabilityPolicy.TRANSIENT_LOCAL,
            header=header,
        )

    async def _start(self) -> dict[str, Any]:
        running = self._recording.scan_id if self._recording else self._opening
        if running:
            raise BusyError(f'recorder: records scan {running} already', scan_id=running)
        folder, scan_id = self.get('scan_folder'), self.get('scan_id')
        if not folder or not scan_id:
            raise ParameterError('recorder: scan_folder and scan_id must be set before start')
        for kind, subject in (
            (_DROPPED, 'bag'),
            (_NOT_WRITTEN, 'bag'),
            (_NOT_WRITTEN, 'catalogue'),
            (_SILENT, 'orchestrator'),
        ):
            self.health.clear(kind, subject)
        self.health.clear_fault('bag')
        opening = partial(
            Recording,
            scan_id,
            # again: a link may have been made since the parameter was set
            folder_below(Path(self.get('scan_root')), folder, 'scan_folder'),
            owner=self.get('owner'),
            first_profile=self.get('first_profile'),
            compress=self.get('compress'),
            max_queued_bytes=self.get('room') * 1024 * 1024,
        )
        self._opening = scan_id
        try:
            # the bag of an interrupted scan is read as a whole
            self._recording = await self.in_thread(opening)
        finally:
            self._opening = ''
        answer = {
            'path': str(self._recording.recorder.folder),
            'topics': list(self._recorded_topics),
        }
        self._follow_streams()
        with contextlib.suppress(TimeoutExceededError):
            # a camera that waits for a trigger publishes nothing yet
            await self._waiter.until(self._hears_streams, _FIRST_MESSAGES_S, 'first messages')
        return answer

    async def _stop(self) -> dict[str, Any]:
        recording, self._recording = self._recording, None
        if recording is None:
            raise StateError('recorder: no recording is running')
        self._follow_streams()
        self._closing.append(recording)
        try:
            path = await self.in_thread(recording.finish)
        finally:
            self._closing.remove(recording)
        if self._recording is None:
            # ``recorded`` has no scan id: it is that of the running scan only
            self._publish(recording)
        counts = recording.recorder.counts
        return {
            'scan_id': recording.scan_id,
            'path': str(path),
            'messages': counts.messages,
            'bytes': counts.bytes,
            'dropped': counts.dropped,
            'recorded': recording.recorder.recorded,
            'catalogue_error': recording.writer.error,
        }

    def _receive_heartbeat(self, message: Header) -> None:
        recording = self._recording
        if recording is None:
            return
        life = life_of(message)
        if not recording.owner:
            recording.owner = life
        if life == recording.owner:
            recording.heard_s = self.steady_s()
        elif self._silent_s(recording) > _REPLACED_S:
            self._abandon(recording, 'the orchestrator was restarted; the recording of '
                          f'scan {recording.scan_id} was stopped')  # fmt: skip

    def _silent_s(self, recording: Recording) -> float:
        """Return the seconds since the owner was heard, or since it began the recording."""
        if recording.heard_s is None:
            recording.heard_s = self.steady_s()
        return self.steady_s() - recording.heard_s

    def _check_orchestrator(self) -> None:
        """Stop the recording of an orchestrator that died: images would fill the disk."""
        patience, recording = self.get('orchestrator_patience'), self._recording
        if recording is None or not recording.owner or not patience:
            return
        silent = self._silent_s(recording)
        if silent > patience:
            self._abandon(recording, f'no heartbeat for {silent:.0f} s; the recording was stopped')

    def _abandon(self, recording: Recording, text: str) -> None:
        self.health.set(_SILENT, 'orchestrator', Level.ERROR, text)
        self.executor.create_task(self._stop_recording, recording)

    async def _stop_recording(self, recording: Recording) -> None:
        if recording is not self._recording:
            # stopped by the service in the meantime
            return
        try:
            await self._stop()
        except ScanError as error:
            self.fault('bag', error)

    def _publish_progress(self) -> None:
        if self._recording is not None:
            self._publish(self._recording)

    def _publish(self, recording: Recording) -> None:
        recorded = recording.recorder.recorded
        if recorded is not None and recorded != recording.published:
            recording.published = recorded
            self._recorded.publish(UInt64(data=recorded))


def _profile_header(data: bytes) -> ProfileHeader:
    return read_profile_header(deserialize_message(data, PointCloud2))


def main() -> None:
    """Run the node."""
    sys.exit(run(Recorder))


if __name__ == '__main__':
    main()
