# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
``triangulator``: pictures in, profiles out.

A picture waits until the table (and the lasers) have been reported past its exposure. The
waiting ones are bounded, and the oldest goes first.
"""

from collections import Counter
from collections.abc import Sequence
import sys

from sensor_msgs.msg import CompressedImage
from sensor_msgs.msg import Image as ImageMessage
from sensor_msgs.msg import JointState
from sensor_msgs.msg import PointCloud2

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.errors import MessageError
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
from ivfmc_ros.nodes.framework.health import Level
from ivfmc_ros.nodes.processing.cell_source import CellSource
from ivfmc_ros.nodes.processing.stripe_image import StripePicture
from ivfmc_ros.nodes.processing.triangulator_parameters import declare
from ivfmc_ros.nodes.processing.triangulator_parameters import match_settings
from ivfmc_ros.storage.frame_matching import Match
from ivfmc_ros.storage.frame_matching import Matcher
from ivfmc_ros.storage.reports import joint_of
from ivfmc_ros.stripe.acquisition import Acquisition
from ivfmc_ros.stripe.acquisition import AcquisitionSettings
from ivfmc_ros.stripe.sampling import Measured
from ivfmc_ros.stripe.sampling import SampledAcquisition

# The first pictures of a scan are measured at once, which takes a while; none is lost meanwhile.
_PICTURE_DEPTH = 90
# Seconds between looks at pictures for which nothing comes any more.
_LOOK_S = 0.05
# Seconds of work at a time, so that messages are taken in and the heart beats in between.
_BUDGET_S = 0.04
# The first pictures of a scan decide together what the settings leave open; after such a pause
# those that came decide. In steps, somebody may wait for a profile before the table turns on.
_SAMPLE_WAIT_S = {'continuous': 5.0, 'step': 1.0}
# Stamps of one clock that come at the same time differ by less.
_ONE_CLOCK_S = 2.0
# Parameters that change how a picture is measured.
_ACQUISITION = ('extract.', 'volume.', 'noise_')


class Triangulator(CellNode):
    """Turns each picture into a profile, at the angle that the table had."""

    def __init__(self) -> None:
        super().__init__('triangulator')
        self._settings = declare(self)
        self._source = CellSource(self)
        self._matcher = Matcher(())
        self._stream: SampledAcquisition | None = None
        self._acquisition: Acquisition | None = None
        self._measured_by: AcquisitionSettings | None = None
        self._counts: Counter[str] = Counter()
        self._seq = 0
        self._last_s = self.steady_s()
        self._working = False
        self._ahead_s = 0.0
        self.changed(self._change)
        self._change({'view', 'cell'})
        self._profiles = self.publish_on(PointCloud2, 'profile')
        self._picture = StripePicture(self)
        self._pictures = AdaptiveSubscription(
            self, ImageMessage, 'image_raw', self._take_picture, depth=_PICTURE_DEPTH
        )
        self._compressed = AdaptiveSubscription(
            self,
            CompressedImage,
            'image_raw/compressed',
            self._take_compressed,
            depth=_PICTURE_DEPTH,
        )
        self._joints = AdaptiveSubscription(self, JointState, 'joint_states', self._take_joints)
        self._lasers = AdaptiveSubscription(self, JointState, 'laser_states', self._take_lasers)
        self.steady_timer(_LOOK_S, self._work)

    def _change(self, names: set[str]) -> None:
        if 'scan_id' in names:
            self._seq = 0
            self._matcher.restart()
            self._source.reload()
            self._counts.clear()
        # cell.yaml may have been written anew, with other lasers
        if 'cell' in names or self._matcher.names != tuple(self._laser_names()):
            self._matcher = Matcher(self._laser_names())
        if 'scan_id' in names or any(name.startswith(_ACQUISITION) for name in names):
            # the first pictures decide anew
            self._stream = None
        self._matcher.settings = match_settings(self.get, self._laser_names())

    def _laser_names(self) -> Sequence[str]:
        draft = self._source.draft
        return [laser.name for laser in draft.lasers] if draft else []

    def _take_picture(self, message: ImageMessage) -> None:
        self._counts['pictures'] += 1
        stamp_ns = nanoseconds(message.header.stamp)
        self._ahead_s = self._matcher.ahead_s(stamp_ns)
        self._matcher.picture(stamp_ns, message, self.steady_s())
        if len(self._matcher) > self.get('queue'):
            self._counts[self._matcher.drop_oldest().reason] += 1
        self._work()

    def _take_compressed(self, message: CompressedImage) -> None:
        # who sends both sends the same picture twice
        if not self._pictures.publishers:
            self._take_picture(message)

    def _take_joints(self, message: JointState) -> None:
        draft = self._source.draft
        joint = draft.turntable.joint if draft and draft.turntable else 'turntable_joint'
        stated = joint_of(message, joint)
        if stated is None:
            stated_there = zip(message.name, message.position, strict=False)
            there = ', '.join(f'{name} {value:g}' for name, value in stated_there) or 'none'
            raise MessageError(
                f'{self._joints.topic}: has no position of joint {joint!r}; joints there: {there}'
            )
        stamp = nanoseconds(message.header.stamp)
        if not self._matcher.table(stamp, *stated, now_s=self.steady_s()):
            self._jumped(self._joints.topic)
        self._work()

    def _take_lasers(self, message: JointState) -> None:
        names = set(self._laser_names())
        if names.isdisjoint(message.name):
            there = ', '.join(message.name) or 'none'
            raise MessageError(
                f'{self._lasers.topic}: names none of the lasers {", ".join(sorted(names))}; '
                f'lasers there: {there}'
            )
        states = dict(zip(message.name, message.position, strict=False))
        stamp = nanoseconds(message.header.stamp)
        if not self._matcher.lasers(stamp, states, self.steady_s()):
            self._jumped(self._lasers.topic)
        self._work()

    def _jumped(self, topic: str) -> None:
        self._counts['jumps'] += 1
        self.get_logger().warning(f'{topic}: stamps jumped back; what was known is forgotten')

    def _work(self) -> None:
        """Take in what waits, and measure the pictures that can be judged, for a while."""
        if self._working or self._is_idle():
            return
        self._working = True
        try:
            for subscription in (self._joints, self._lasers, self._pictures):
                subscription.drain()
            self._measure_ready(self.steady_s())
        finally:
            self._working = False

    def _measure_ready(self, start: float) -> None:
        stream = self._ready_stream()
        if stream is None:
            return
        for match in self._matcher.ready(start, self.get('patience')):
            self._measure(stream, match)
            if self.steady_s() - start > _BUDGET_S:
                return
        if stream.waiting and start - self._last_s > _SAMPLE_WAIT_S[self.get('motion')]:
            self._publish(stream.flush())

    def _is_idle(self) -> bool:
        if self._stream is None and self._source.complete:
            # now, and not when the first picture comes
            self._ready_stream()
        return not len(self._matcher) and not (self._stream and self._stream.waiting)

    def _ready_stream(self) -> SampledAcquisition | None:
        """Return what measures; None, and a condition by name, while something is missing."""
        try:
            cell = self._source.cell()
            if self._stream is None or self._stream.acquisition.cell is not cell:
                self._require_one_laser(cell)
                self._stream = SampledAcquisition(self._new_acquisition(cell))
        except ScanError as error:
            self.trouble('cell', error)
            return None
        self.health.clear('cell')
        return self._stream

    def _new_acquisition(self, cell: Cell) -> Acquisition:
        """Return one for a scan; where the stripe can be takes half a second to find out."""
        known, settings = self._acquisition, self._settings()
        if known is not None and known.cell is cell and self._measured_by == settings:
            return known.restarted()
        self._acquisition, self._measured_by = Acquisition(cell, settings), settings
        return self._acquisition.restarted()

    def _require_one_laser(self, cell: Cell) -> None:
        if self.get('laser_source') == 'always_on' and len(cell.lasers) != 1:
            names = ', '.join(laser.name for laser in cell.lasers)
            raise ParameterError(
                f'laser_source: always_on needs a cell of one laser; this one has {names}'
            )

    def _measure(self, stream: SampledAcquisition, match: Match) -> None:
        if match.reason:
            self._counts[match.reason] += 1
            return
        try:
            image = self._image(match.payload)
            where = f'{self._pictures.topic} and camera_info do not go together'
            stream.acquisition.cell.camera.require_image(image.shape, where)
            frame = Frame(
                image=image,
                stamp_ns=match.stamp_ns,
                angle=match.angle,
                laser=match.laser,
                view=match.view,
                seq=self._seq,
                speed=match.speed,
                dark=self._image(match.dark.payload) if match.dark else None,
            )
            measured = stream.add(frame)
        except ScanError as error:
            self._counts['refused'] += 1
            self.trouble('picture', error)
            return
        # pictures that are not used must not make those wait that are
        self._last_s = self.steady_s()
        self._seq += 1
        self.health.clear('picture')
        self._publish(measured)

    def _image(self, message: ImageMessage | CompressedImage) -> Image:
        return images.from_image(message, self._pictures.topic)

    def _publish(self, measured: Measured) -> None:
        for _, profile in measured:
            self._profiles.publish(clouds.from_profile(profile))
            self._counts['profiles'] += 1
            self._counts['empty profiles'] += not len(profile)
        # what goes wrong with a picture to look at must cost no profile
        for frame, profile in measured:
            self._picture.show(frame, profile)

    def before_diagnosis(self) -> None:
        """Say by name what has not come, and how many pictures became what."""
        waiting = len(self._matcher)
        self._miss('image_raw', bool(self._counts['pictures']), self._pictures)
        self._miss('joint_states', self._matcher.table_known, self._joints)
        self._miss('laser_states', self._matcher.lasers_known, self._lasers)
        self._compare_clocks()
        counted = ', '.join(f'{count} {name}' for name, count in self._counts.items() if count)
        self.status(Level.OK, '', waiting=waiting, counts=counted, scan_id=self.get('scan_id'))

    def _compare_clocks(self) -> None:
        ahead = self._ahead_s
        text = (
            f'{self._pictures.topic}: stamps are {abs(ahead):.1f} s '
            f'{"ahead of" if ahead > 0.0 else "behind"} those of {self._joints.topic}; '
            'do their clocks agree?'
        )
        wrong = abs(ahead) > _ONE_CLOCK_S
        self.health.set('clocks', Level.WARN if wrong else Level.OK, text if wrong else '')

    def _miss(self, name: str, come: bool, subscription: AdaptiveSubscription) -> None:
        if come or name in self.health.conditions:
            # a message that comes takes the condition back itself
            return
        self.health.set(
            name,
            Level.WARN,
            f'{name}: none has come on {subscription.topic}, which '
            f'{"has a publisher" if subscription.publishers else "nobody publishes"}',
        )


def main() -> None:
    """Run the node."""
    sys.exit(run(Triangulator))


if __name__ == '__main__':
    main()
