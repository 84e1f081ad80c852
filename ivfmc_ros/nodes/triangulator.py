# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Executable ``triangulator``: camera images to laser profiles in the turntable frame.

Subscribes to image_raw, camera_info, joint_states and laser_states; publishes ``profile``, and
``stripe_image/compressed`` for debugging. An image waits in a bounded queue until table and lasers
have been reported past its exposure; when the queue is full, the oldest image is dropped.
"""

from collections import Counter
from collections.abc import Sequence
from functools import partial
import sys

from sensor_msgs.msg import CompressedImage
from sensor_msgs.msg import Image as ImageMessage
from sensor_msgs.msg import JointState
from sensor_msgs.msg import PointCloud2

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.errors import NotReadyError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Image
from ivfmc_ros.nodes.convert import clouds
from ivfmc_ros.nodes.convert import images
from ivfmc_ros.nodes.convert.stamps import nanoseconds
from ivfmc_ros.nodes.framework.adaptive_subscription import AdaptiveSubscription
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.base import run
from ivfmc_ros.nodes.framework.life import HEARTBEAT_S
from ivfmc_ros.nodes.processing.cell_frames import CellFrames
from ivfmc_ros.nodes.processing.cell_source import CellSource
from ivfmc_ros.nodes.processing.image_checks import ImageChecks
from ivfmc_ros.nodes.processing.image_input import ImageInput
from ivfmc_ros.nodes.processing.stamp_conditions import StampConditions
from ivfmc_ros.nodes.processing.stripe_image import StripeImagePublisher
from ivfmc_ros.nodes.processing.triangulator_parameters import declare
from ivfmc_ros.nodes.processing.triangulator_parameters import match_settings
from ivfmc_ros.storage.matching.frame_matching import FrameMatch
from ivfmc_ros.storage.matching.frame_matching import FrameMatcher
from ivfmc_ros.storage.matching.image_loss import ImageLoss
from ivfmc_ros.storage.matching.joint_history import joint_in_message
from ivfmc_ros.storage.messages.rectified import require_raw_images
from ivfmc_ros.stripe.acquisition import Acquisition
from ivfmc_ros.stripe.acquisition import AcquisitionSettings
from ivfmc_ros.stripe.opencv_threads import use_one_thread
from ivfmc_ros.stripe.stream import FrameProfiles
from ivfmc_ros.stripe.stream import StreamAcquisition

# Queue of image messages: 1.5 s at 60 images/s, the time that the first images of a scan take,
# which are processed together (``StreamAcquisition``).
_IMAGE_DEPTH = 90
# Seconds between two checks for images whose time-out (``patience``) has passed.
_POLL_S = 0.05
# Seconds of work in one callback, so that messages and the heartbeat are handled in between.
_BUDGET_S = 0.04
# The first images of a scan determine the automatic settings together. Seconds without a further
# image after which those received so far do; in step motion the table may wait for a profile.
_SAMPLE_WAIT_S = {'continuous': 5.0, 'step': 1.0}
# Seconds with all lasers off after which no images are received: none of them could be used.
_REST_AFTER_S = 10.0
# Value of a laser in laser_states from which it is on.
_ON = 0.5
# Joint name while there is no cell.yaml.
_DEFAULT_JOINT = 'turntable_joint'
# Prefixes of the parameters that change how an image is processed.
_ACQUISITION = ('extract.', 'volume.', 'noise_')


class Triangulator(CellNode):
    """Publishes a profile for each image, at the table angle at its stamp."""

    def __init__(self) -> None:
        super().__init__('triangulator')
        self._settings = declare(self)
        self._source = CellSource(self)
        self._matcher = FrameMatcher(())
        self._stream: StreamAcquisition | None = None
        self._acquisition: Acquisition | None = None
        self._acquisition_settings: AcquisitionSettings | None = None
        self._counts: Counter[str] = Counter()
        self._loss = ImageLoss()
        self._source.on_camera_info = lambda info: self._loss.add_info(
            nanoseconds(info.header.stamp)
        )
        self._seq = 0
        self._last_profile_s = self._beat_s = self.steady_s()
        self._working = False
        self._stamps = StampConditions(self)
        self._image_checks = ImageChecks(self, self._laser_names)
        # what messages without our joint or lasers have instead, by topic
        self._others: dict[str, str] = {}
        self.changed(self._change)
        self._change({'view', 'cell'})
        self._frames = CellFrames(self, self._source)
        self._profiles = self.publish_on(PointCloud2, 'profile')
        self._stripe_image = StripeImagePublisher(self)
        self._camera = ImageInput(self, self._receive_image, _IMAGE_DEPTH)
        self._images = self._camera.raw
        self._joints = AdaptiveSubscription(self, JointState, 'joint_states', self._receive_joints)
        self._lasers = AdaptiveSubscription(self, JointState, 'laser_states', self._receive_lasers)
        self._expect_inputs()
        # steady second at which a laser was on, or a parameter set
        self._lit_s = self.steady_s()
        self.changed(lambda _: self._wake())
        self._poll = self.steady_timer(_POLL_S, self._work_on)

    def _expect_inputs(self) -> None:
        for name, subscription, received in (
            (
                'image_raw',
                self._images,
                lambda: self._counts['pictures'] or self._images.is_paused,
            ),
            ('joint_states', self._joints, lambda: self._matcher.table_known),
            ('laser_states', self._lasers, lambda: self._matcher.lasers_known),
        ):
            text = partial(self._waiting_text, name, subscription)
            self.expect(name, received, text, f'received on {subscription.topic}')

    def _waiting_text(self, name: str, subscription: AdaptiveSubscription) -> str:
        awaited = self._others.get(name, 'a message')
        where = f'{subscription.topic} (publishers: {subscription.publishers})'
        return f'waiting for {awaited} on {where}'

    def _change(self, names: set[str]) -> None:
        if 'scan_id' not in names and any(name.startswith(_ACQUISITION) for name in names):
            # they have numbers already, and were taken with the settings before
            self._finish_stream()
        if 'scan_id' in names:
            self._seq = self.get('first_profile')
            self._matcher.reset()
            self._image_checks.restart()
            self._source.reload()
            self._counts.clear()
            self._loss = ImageLoss()
        # cell.yaml may have changed, with other lasers
        if 'cell' in names or self._matcher.laser_names != tuple(self._laser_names()):
            self._matcher = FrameMatcher(self._laser_names())
        if 'scan_id' in names or any(name.startswith(_ACQUISITION) for name in names):
            # the next images determine the automatic settings again
            self._stream = None
        self._matcher.settings = match_settings(self.get, self._laser_names())

    def _laser_names(self) -> Sequence[str]:
        draft = self._source.draft
        return [laser.name for laser in draft.lasers] if draft else []

    def _receive_image(self, message: ImageMessage | CompressedImage) -> None:
        self._counts['pictures'] += 1
        stamp_ns = nanoseconds(message.header.stamp)
        self._loss.add_image(stamp_ns)
        self._stamps.clock_offset_s = self._matcher.ahead_of_table_s(stamp_ns)
        self._matcher.add_image(stamp_ns, message, self.steady_s())
        # after an image, so that no camera_info is without one
        self._source.infos.resume()
        if self._poll.is_canceled():
            self._poll.reset()
        if len(self._matcher) > self.get('queue'):
            self._counts[self._matcher.drop_oldest().reason] += 1
        self._work()

    def _receive_joints(self, message: JointState) -> None:
        draft = self._source.draft
        joint = draft.turntable.joint if draft and draft.turntable else _DEFAULT_JOINT
        state = joint_in_message(message, joint)
        if state is None:
            # normal where other devices publish on the same topic
            positions = zip(message.name, message.position, strict=False)
            names = ', '.join(f'{name} {value:g}' for name, value in positions) or 'none'
            self._others['joint_states'] = (
                f'position of joint {joint!r}; last message has joints: {names}'
            )
            return
        stamp_ns = nanoseconds(message.header.stamp)
        self._frames.turn(stamp_ns, state[0])
        if not self._matcher.add_table_position(stamp_ns, *state, now_s=self.steady_s()):
            self._report_jump(self._joints.topic)
        self._work()

    def _receive_lasers(self, message: JointState) -> None:
        names = self._laser_names()
        if set(names).isdisjoint(message.name):
            others = ', '.join(message.name) or 'none'
            self._others['laser_states'] = (
                f'state of the lasers {", ".join(names)}; last message has: {others}'
            )
            return
        states = dict(zip(message.name, message.position, strict=False))
        if any(states.get(name, 0.0) > _ON for name in names):
            self._wake()
        stamp_ns = nanoseconds(message.header.stamp)
        if not self._matcher.add_laser_states(stamp_ns, states, self.steady_s()):
            self._report_jump(self._lasers.topic)
        self._work()

    def _report_jump(self, topic: str) -> None:
        self._counts['jumps'] += 1
        self._stamps.report_jump(topic)

    def _wake(self) -> None:
        """Receive images: a laser is on, or will be."""
        self._lit_s = self.steady_s()
        if self._camera.is_paused:
            self._loss = ImageLoss()
            self._camera.resume()

    def _rest(self) -> None:
        """Receive no images while the lasers are off for long: they would wake this node."""
        # an orchestrator sets a parameter before it takes profiles; a replay of images does not
        if not self.count_publishers('orchestrator/heartbeat'):
            return
        is_dark = self.get('laser_source') == 'topic' and self._matcher.lasers_known
        is_long = self.steady_s() - self._lit_s > _REST_AFTER_S
        if is_dark and is_long and self._is_idle() and not self.get('subtract_dark'):
            self._camera.pause()
            self._source.infos.pause()

    def _work_on(self) -> None:
        self._work()
        if self._is_idle():
            # until the next image
            self._poll.cancel()

    def _work(self) -> None:
        """Receive queued messages, then process images for up to ``_BUDGET_S``."""
        if self._working or self._is_idle():
            return
        self._working = True
        try:
            for subscription in (self._source.infos, self._joints, self._lasers, self._images):
                subscription.drain()
            self._process_matches(self.steady_s())
        finally:
            self._working = False

    def _process_matches(self, start: float) -> None:
        stream = self._ready_stream()
        if stream is None:
            return
        for match in self._matcher.pop_matches(start, self.get('patience')):
            self._process(stream, match)
            if self.steady_s() - start > _BUDGET_S:
                return
        if stream.waiting and start - self._last_profile_s > _SAMPLE_WAIT_S[self.get('motion')]:
            self._flush(stream)

    def _flush(self, stream: StreamAcquisition) -> None:
        """Publish the profiles of the first images, or the reason why they are refused."""
        waiting = stream.waiting
        try:
            measured = stream.flush()
        except ScanError as error:
            self._counts['refused'] += waiting
            self.fault('image', error)
            return
        self._publish(measured)

    def _is_idle(self) -> bool:
        if self._stream is None and self._source.complete:
            # prepare before the first image is received
            self._ready_stream()
        return not len(self._matcher) and not (self._stream and self._stream.waiting)

    def _ready_stream(self) -> StreamAcquisition | None:
        """Return the acquisition; None, with a condition, while the cell is incomplete."""
        try:
            cell = self._source.cell()
            if self._stream is None or self._stream.acquisition.cell is not cell:
                self._finish_stream()
                self._require_one_laser(cell)
                require_raw_images(self._images.topic, cell.camera)
                self._stream = StreamAcquisition(
                    self._new_acquisition(cell), on_progress=self._show_progress
                )
        except NotReadyError:
            # a condition of the CellSource
            return None
        except ScanError as error:
            self.fault('cell', error)
            return None
        self.health.clear_fault('cell')
        return self._stream

    def _show_progress(self) -> None:
        """Publish a heartbeat while one callback processes many images."""
        if self.steady_s() - self._beat_s > HEARTBEAT_S:
            self._beat_s = self.steady_s()
            self.life.beat()

    def _finish_stream(self) -> None:
        """Publish the profiles of the first images, which wait for their common settings."""
        stream, self._stream = self._stream, None
        if stream is not None:
            self._flush(stream)

    def _new_acquisition(self, cell: Cell) -> Acquisition:
        """Return an acquisition; reuses the image mask, whose computation takes 0.5 s."""
        known, settings = self._acquisition, self._settings()
        if known is not None and known.cell is cell and self._acquisition_settings == settings:
            return known.for_new_scan()
        self._acquisition, self._acquisition_settings = Acquisition(cell, settings), settings
        return self._acquisition.for_new_scan()

    def _require_one_laser(self, cell: Cell) -> None:
        if self.get('laser_source') == 'always_on' and len(cell.lasers) != 1:
            names = ', '.join(laser.name for laser in cell.lasers)
            raise ParameterError(
                f'laser_source: always_on requires a cell with one laser; cell.yaml has {names}'
            )

    def _process(self, stream: StreamAcquisition, match: FrameMatch) -> None:
        if match.reason:
            self._counts[match.reason] += 1
            self._image_checks.add_unused(match, self._image)
            return
        try:
            image = self._image(match.payload)
            where = f'{self._images.topic} and camera_info do not match'
            stream.acquisition.cell.camera.require_image_size(image.shape, where)
            frame = Frame(
                image=image,
                stamp_ns=match.stamp_ns,
                angle=match.angle,
                laser=match.laser,
                view=match.view,
                seq=self._seq,
                speed=match.speed,
                dark=self._image(match.dark.payload) if match.dark else None,
                bracket=tuple(self._image(other.payload) for other in match.bracket),
            )
            measured = stream.add(frame)
        except ScanError as error:
            self._counts['refused'] += 1
            self.fault('image', error)
            return
        # images that are not used must not delay those that are
        self._last_profile_s = self.steady_s()
        self._seq += 1
        if measured:
            self.health.clear_fault('image')
        self._publish(measured)

    def _image(self, message: ImageMessage | CompressedImage) -> Image:
        return images.from_image(message, self._images.topic)

    def _publish(self, measured: FrameProfiles) -> None:
        for _, profile in measured:
            self._profiles.publish(clouds.from_profile(profile))
            self._counts['profiles'] += 1
            self._counts['empty profiles'] += not len(profile)
        # last, so that an error in a debug image costs no profile
        for frame, profile in measured:
            self._image_checks.add_measured(frame, profile)
            self._stripe_image.publish(frame, profile)

    def before_diagnosis(self) -> None:
        """Publish how many images became profiles, and why the others did not."""
        self._stamps.update(self._images.topic, self._joints.topic)
        self._stamps.judge_table(self._matcher.table_fault, self._joints.topic)
        if self._source.complete:
            self._rest()
        self._image_checks.update(self._stream.acquisition if self._stream else None)
        counts = ', '.join(f'{count} {name}' for name, count in self._counts.items() if count)
        self.status(
            '',
            waiting=len(self._matcher),
            counts=counts,
            scan_id=self.get('scan_id'),
            images_not_received=self._loss.not_received,
            images_not_taken=self._loss.not_taken,
            **self._image_checks.figures,
            table_fault=self._stamps.table_fault,
            tf=self._frames.state,
            # matched ones: what is published before is lost to a subscription that joins
            profile_subscriptions=self._profiles.get_subscription_count(),
        )


def main() -> None:
    """Run the node."""
    use_one_thread()
    sys.exit(run(Triangulator))


if __name__ == '__main__':
    main()
