# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Publishes topics of a bag, at a given rate or as fast as the nodes process the images."""

from collections.abc import Callable
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
import time
from typing import Any

from ivfmc_ros.cli.support.client import CellClient
from ivfmc_ros.errors import HelperError
from ivfmc_ros.storage.bag.bag_file import RawMessage
from ivfmc_ros.storage.bag.reader import Bag
from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.storage.messages.image_decoding import decode_compressed
from ivfmc_ros.storage.messages.profile_header import ProfileHeader
from ivfmc_ros.storage.messages.sensor_messages import COMPRESSED_IMAGE
from ivfmc_ros.storage.messages.sensor_messages import IMAGE
from ivfmc_ros.storage.messages.sensor_messages import image as image_message

# Images in flight; fewer than the history of the triangulator, so that none is lost.
_WINDOW = 10
# Seconds to wait for the profile of an image: some give none (laser off, table moving). The first
# one may take longer, because the triangulator loads its calibration.
_PATIENCE_S = 1.0
_FIRST_PATIENCE_S = 10.0
_DRAIN_S = 120.0
# One view for each laser, for more lasers than any cell has: an empty list has no type to send.
OWN_VIEWS = list(range(16))
_CALM_S = 1.5
_SPIN_S = 0.002
# Seconds: on a busy machine other publishers are discovered late, and their names later still.
_LOOK_S = 1.0
_NAME_S = 2.0
_NAMELESS = '_NODE_NAME_UNKNOWN_'


@dataclass(frozen=True, kw_only=True)
class Track:
    """
    One topic of a bag and the topic on which it is published.

    picture : its messages are images, of which at most ``_WINDOW`` are in flight
    decode : decodes compressed images, which are published raw
    """

    source: str
    target: str
    msgtype: str
    picture: bool = False
    decode: Callable[[RawMessage], Any] | None = None


def target_of(bag: Bag, source: str, target: str, picture: bool = False) -> Track:
    """Return how a topic is published: compressed images are decoded for the triangulator."""
    msgtype = cdr.full_name(bag.topic(source).msgtype)
    if picture and msgtype == COMPRESSED_IMAGE:
        decode = bag.decoder(source)
        return Track(source=source, target=target, msgtype=IMAGE, picture=True, decode=decode)
    return Track(source=source, target=target, msgtype=msgtype, picture=picture)


def message_class(msgtype: str) -> Any:
    """
    Return the class of a type such as 'sensor_msgs/msg/Image'.

    :raises HelperError: its package is not installed
    """
    package, _, name = msgtype.partition('/msg/')
    try:
        return getattr(import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError) as error:
        raise HelperError('NO_ROS', f'{msgtype}: is not installed ({error})') from error


class BagPlayer:
    """Publishes some topics of a bag in their order."""

    def __init__(
        self,
        client: CellClient,
        bag: Bag,
        tracks: Mapping[str, Track],
        clock: bool = False,
        recorded: Mapping[int, ProfileHeader] | None = None,
        *,
        every: bool = False,
    ) -> None:
        """
        Prepare to publish.

        tracks : by the topic in the bag
        clock : publish /clock, too
        recorded : what pictures became when they were recorded, by stamp; the others are left
            out then, and the triangulator is told of each sweep as it was
        every : leave none out; those with the lasers off are needed, too
        """
        from diagnostic_msgs.msg import DiagnosticArray
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import PointCloud2

        from ivfmc_ros.nodes.framework import qos

        self._client = client
        self._bag = bag
        self._tracks = tracks
        self._recorded = recorded or {}
        self._views = list(OWN_VIEWS)
        self._every = every
        node = client.node
        self._publishers = {
            track.target: node.create_publisher(
                message_class(track.msgtype), track.target, qos.of_topic(track.target)
            )
            for track in tracks.values()
        }
        self._clock = node.create_publisher(Clock, '/clock', qos.reliable(10)) if clock else None
        self.profiles = 0
        self.pictures = 0
        self._under_way: list[int] = []
        self._last_profile = time.monotonic()
        self._judged: dict[str, int] = {}
        node.create_subscription(
            PointCloud2, 'profile', self._hear_profile, qos.of_topic('profile')
        )
        node.create_subscription(
            DiagnosticArray, '/diagnostics', self._hear_diagnostics, qos.reliable(50)
        )

    def await_listeners(self, seconds: float) -> None:
        """:raises HelperError: a topic has no subscriber, or another publisher."""
        names = ', '.join(p.topic_name for p in self._publishers.values())
        self._client.until(self._is_heard, seconds, f'subscribers of {names}')
        # a subscriber that adapts its QoS to ours subscribes again and receives nothing meanwhile
        calm = time.monotonic() + _CALM_S
        while time.monotonic() < calm:
            self._client.spin(_SPIN_S)
            if not self._is_heard():
                calm = time.monotonic() + _CALM_S
        self._refuse_others()

    def _is_heard(self) -> bool:
        return all(p.get_subscription_count() > 0 for p in self._publishers.values())

    def play(self, rate: float, progress: Callable[[int], None]) -> None:
        """
        Publish everything.

        rate : times the recorded speed; 0.0 is as fast as pictures become profiles
        progress : is called with the number of messages that are out
        :raises HelperError: another publisher of one of the topics appears
        """
        start: tuple[float, int] | None = None
        looked = time.monotonic()
        for count, raw in enumerate(self._bag.messages(self._tracks.keys()), start=1):
            if rate > 0.0:
                start = start or (time.monotonic(), raw.log_time_ns)
                self._sleep_until(start[0] + (raw.log_time_ns - start[1]) * 1e-9 / rate)
            self._publish(raw)
            progress(count)
            if rate == 0.0:
                self._hold_back()
            if time.monotonic() - looked > _LOOK_S:
                self._refuse_others()
                looked = time.monotonic()
        self._drain()

    def _refuse_others(self) -> None:
        for track in self._tracks.values():
            names = self._others(track)
            end = time.monotonic() + _NAME_S
            while any(_NAMELESS in name for name in names) and time.monotonic() < end:
                self._client.spin(_SPIN_S)
                names = self._others(track)
            if names:
                raise HelperError(
                    'BUSY',
                    f'{track.target} is published by {", ".join(sorted(names))}; end that first '
                    "('ivfmc up --replay' starts no camera and no turntable)",
                )

    def _others(self, track: Track) -> set[str]:
        """Return the names of other nodes that publish a topic."""
        node = self._client.node
        infos = node.get_publishers_info_by_topic(node.resolve_topic_name(track.target))
        own = node.get_name()
        return {f'{i.node_namespace}/{i.node_name}' for i in infos if i.node_name != own}

    def _publish(self, raw: RawMessage) -> None:
        track = self._tracks[raw.topic]
        data, stamp_ns = bytes(raw.data), raw.log_time_ns
        if track.decode is not None:
            message = track.decode(raw)
            stamp_ns = cdr.stamp_ns(message)
            data = cdr.encode(image_message(stamp_ns, decode_compressed(message, raw.topic)))
        elif track.picture:
            stamp_ns = self._bag.stamp_ns(raw)
        if track.picture and self._recorded:
            head = self._recorded.get(stamp_ns)
            if head is not None:
                self._select(head)
            elif not self._every:
                return
        if self._clock is not None:
            self._tell_clock(raw.log_time_ns)
        self._publishers[track.target].publish(data)
        if track.picture:
            self.pictures += 1
            self._under_way.append(stamp_ns)
        self._client.spin(0.0)

    def _select(self, head: ProfileHeader) -> None:
        """Set the view of each laser for the images that follow, as in the recorded scan."""
        if self._views[head.laser] == head.view:
            return
        # images in flight belong to the sweep before
        self._drain()
        self._views[head.laser] = head.view
        self._client.set_parameters('triangulator', {'view': self._views})

    def _tell_clock(self, stamp_ns: int) -> None:
        from builtin_interfaces.msg import Time
        from rosgraph_msgs.msg import Clock

        seconds, nanoseconds = divmod(stamp_ns, cdr.NANOSECONDS)
        self._clock.publish(Clock(clock=Time(sec=seconds, nanosec=nanoseconds)))  # type: ignore[union-attr]

    def _hear_profile(self, message: Any) -> None:
        stamp_ns = cdr.stamp_ns(message)
        self.profiles += 1
        self._last_profile = time.monotonic()
        self._under_way = [waiting for waiting in self._under_way if waiting > stamp_ns]

    def _hold_back(self) -> None:
        """Wait while many images are in flight, but not for those that give no profile."""
        begin = time.monotonic()
        while len(self._under_way) >= _WINDOW:
            self._client.spin(_SPIN_S)
            patience = _PATIENCE_S if self.profiles else _FIRST_PATIENCE_S
            if time.monotonic() - max(begin, self._last_profile) > patience:
                self._under_way.clear()

    def _drain(self) -> None:
        """
        Wait until the triangulator says that it is through with all pictures.

        :raises HelperError: it does not, for so long that it never will
        """
        self._judged = {}
        self._client.until(self._is_through, _DRAIN_S, 'the triangulator to measure all pictures')

    def _is_through(self) -> bool:
        judged = dict(self._judged)
        taken = judged.pop('pictures', 0)
        for name in ('empty profiles', 'jumps'):
            judged.pop(name, None)
        profiles = judged.get('profiles', 0)
        return (
            taken >= self.pictures
            and sum(judged.values()) >= taken
            and (self.profiles >= profiles)
        )

    def _hear_diagnostics(self, message: Any) -> None:
        name = f'{self._client.namespace}/triangulator'.strip('/')
        for status in message.status:
            if status.name.strip('/') == name:
                values = {item.key: item.value for item in status.values}
                self._judged = _counts(values.get('counts', ''))

    def _sleep_until(self, moment: float) -> None:
        while (left := moment - time.monotonic()) > 0.0:
            self._client.spin(min(left, 0.02))


def _counts(text: str) -> dict[str, int]:
    """Read '48 pictures, 40 profiles, 8 laser off'."""
    found = {}
    for part in text.split(', '):
        number, _, name = part.partition(' ')
        if number.isdigit():
            found[name] = int(number)
    return found
