# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Assigns table angle, laser and view number to camera images by their stamps.

The same class matches the images of a bag and the messages of a running graph, so a scan that is
replayed or reconstructed has the profiles that it had live. An image waits until joint_states and
laser_states have arrived past its exposure; after a timeout it is matched with the states that
are known by then.
"""

from bisect import insort
from collections.abc import Iterator
from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace
import math
from typing import Any

import numpy as np

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.storage.matching.joint_history import JointHistory
from ivfmc_ros.storage.matching.laser_history import LASER_OFF
from ivfmc_ros.storage.matching.laser_history import LaserHistory
from ivfmc_ros.storage.messages.cdr import NANOSECONDS
from ivfmc_ros.validation import require_in_range
from ivfmc_ros.validation import require_one_of

_TURN = 2.0 * math.pi

MOTIONS = ('continuous', 'step')

# Greatest number of exposures of one position.
MAX_EXPOSURES = 9
# Why an image is not used by itself: it belongs to the profile of the last of its exposures.
OTHER_EXPOSURE = 'one of several exposures'
# The laser of an image has no view; and the position has its profile already (step motion).
NOT_MEASURED = 'laser not measured'
SAME_POSITION = 'angle measured already'
_AT_ANGLE = (NOT_MEASURED, SAME_POSITION)
# One image was exposed at the stamp: a driver that stamps two alike does not know when.
SAME_STAMP = 'stamp of another image'

# States that are this much older than an image, nanoseconds, are not late but of another clock.
_OTHER_CLOCK_NS = 10 * NANOSECONDS

# States are stored for this time, seconds: longer than an image may be late.
HISTORY_S = 30.0


@dataclass(frozen=True, kw_only=True)
class MatchSettings:
    """
    Conditions under which an image becomes a profile.

    motion : continuous (every image with exactly one laser on), or step (only images exposed at
        standstill of the table, one for each view and angle)
    exposure : seconds; an image during which a laser was switched is not used
    stamp_delay : seconds by which a stamp is later than the start of the exposure, at most: of
        drivers that stamp the arrival. Table and lasers must be as at the stamp since then
    always_on : the only laser of the cell is always on and not reported in laser_states
    views : view number of each laser in the order of the cell, -1 for a laser that is not
        measured; empty: the index of the laser
    settle : seconds of standstill before the exposure (step)
    stand : reported motion of a table at standstill, at most, radians (step)
    min_step : angle differences below this, radians, count as the same position (step)
    dark : assign to each image the last one that was exposed with all lasers off at the same
        position (step)
    exposures : number of images of one view at the same position that make one profile, taken with
        different exposure times; the table stands still for them
    """

    motion: str = 'continuous'
    exposure: float = 0.02
    stamp_delay: float = 0.0
    always_on: bool = False
    views: tuple[int, ...] = ()
    settle: float = 0.1
    stand: float = 2e-4
    min_step: float = 1e-3
    dark: bool = False
    exposures: int = 1

    def __post_init__(self) -> None:
        require_in_range('exposures', self.exposures, 1, MAX_EXPOSURES, 'images')
        if self.exposures > 1 and self.dark:
            raise ParameterError(
                'exposures: several exposures and dark frames do not go together: a dark frame '
                'belongs to one exposure'
            )
        require_one_of('motion', self.motion, MOTIONS)
        if self.stamp_delay and self.dark:
            raise ParameterError(
                'stamp_delay: dark frames need stamps of the start of the exposure'
            )
        require_in_range('exposure', self.exposure, 0.0, 10.0, 's')
        require_in_range('stamp_delay', self.stamp_delay, 0.0, 10.0, 's')
        require_in_range('settle', self.settle, 0.0, 60.0, 's')
        require_in_range('stand', self.stand, 0.0, 0.1, 'rad')
        require_in_range('min_step', self.min_step, 0.0, math.pi, 'rad')
        if any(not -1 <= view <= 65535 for view in self.views):
            raise ParameterError(f'view: {list(self.views)}: each must be -1 to 65535')

    def view_of(self, laser: int) -> int:
        """Return the view number of a laser, -1 where it is not measured."""
        if not self.views:
            return laser
        return self.views[laser] if laser < len(self.views) else -1


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameMatch:
    """
    The result for one image.

    payload : the image as it was passed to ``add_image``
    reason : why the image is not used; empty where it is used
    angle : table angle, radians, without the whole turns at the start of the scan; exact in
        single precision, as it is published; also known for NOT_MEASURED and SAME_POSITION, and
        where the lasers were off, after the first image that is used
    speed : velocity of the table, radians per second
    laser : index of the laser in the order of the cell
    dark : the dark frame of the same position, where it is requested and was received
    bracket : the other exposures of the same view and position, if several are requested
    """

    payload: Any
    stamp_ns: int
    reason: str = ''
    angle: float = math.nan
    speed: float = 0.0
    laser: int = 0
    view: int = 0
    dark: 'DarkFrame | None' = None
    bracket: tuple['FrameMatch', ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class DarkFrame:
    """An image that was exposed with all lasers off, the table at standstill at ``angle``, rad."""

    payload: Any
    stamp_ns: int
    angle: float


@dataclass(order=True)
class _WaitingImage:
    stamp_ns: int
    number: int
    received_s: float
    payload: Any
    settings: MatchSettings


class FrameMatcher:
    """Assigns angle and laser to images; messages may be late, out of order or missing."""

    def __init__(
        self,
        lasers: Sequence[str],
        settings: MatchSettings | None = None,
        history_s: float = HISTORY_S,
        *,
        joint_history: JointHistory | None = None,
        laser_history: LaserHistory | None = None,
    ) -> None:
        """
        Start without images.

        lasers : names, in the order of the cell
        history_s : states are stored for this time, seconds
        joint_history, laser_history : states that are known already, as those of a bag
        """
        self.settings = settings or MatchSettings()
        self._history_s = history_s
        self._lasers = tuple(lasers)
        self._joint_history = joint_history or JointHistory()
        self._laser_history = laser_history or LaserHistory(self._lasers)
        self._waiting: list[_WaitingImage] = []
        self._image_count = 0
        self._table_received_s = -math.inf
        self._lasers_received_s = -math.inf
        self.reset()

    def __len__(self) -> int:
        """Return the number of images that wait."""
        return len(self._waiting)

    @property
    def laser_names(self) -> tuple[str, ...]:
        """Names of the lasers, in the order of the cell."""
        return self._lasers

    @property
    def table_known(self) -> bool:
        """Whether a table position has been received."""
        return bool(self._joint_history.stamps_ns)

    @property
    def lasers_known(self) -> bool:
        """Whether laser states have been received, or are not needed."""
        return self.settings.always_on or bool(self._laser_history.stamps_ns)

    def ahead_of_table_s(self, stamp_ns: int) -> float:
        """Return a stamp minus the newest stamp of the table, seconds; 0 without any."""
        stamps = self._joint_history.stamps_ns
        return (stamp_ns - stamps[-1]) / NANOSECONDS if stamps else 0.0

    def reset(self) -> None:
        """Begin a scan: clear what depends on earlier images; table and laser states remain."""
        self._matched_ns: int | None = None
        self._turns: float | None = None
        self._measured_angles: dict[int, float] = {}
        self._dark: DarkFrame | None = None
        self._brackets: dict[int, list[FrameMatch]] = {}

    @property
    def table_fault(self) -> str:
        """Why the newest table positions cannot be right; '' if they can."""
        stamps = self._joint_history.stamps_ns
        return self._joint_history.fault_at(stamps[-1]) if stamps else ''

    def add_table_position(
        self, stamp_ns: int, position: float, velocity: float | None = None, now_s: float = 0.0
    ) -> bool:
        """
        Add a table position.

        position, velocity : radians and radians per second; None for an unknown velocity
        now_s : time of reception on a monotonic clock, seconds
        :returns: False where the stamps jumped back, which deletes all earlier positions
        """
        self._table_received_s = now_s
        self._joint_history.delete_older_than(self._history_s)
        return self._joint_history.add(stamp_ns, position, velocity)

    def add_laser_states(
        self, stamp_ns: int, states: Mapping[str, float], now_s: float = 0.0
    ) -> bool:
        """
        Add laser states.

        states : by name; above 0.5 is on
        now_s : time of reception on a monotonic clock, seconds
        :returns: False where the stamps jumped back, which deletes all earlier states
        """
        self._lasers_received_s = now_s
        self._laser_history.delete_older_than(self._history_s)
        return self._laser_history.add(stamp_ns, states)

    def add_image(self, stamp_ns: int, payload: Any, now_s: float = 0.0) -> None:
        """
        Add an image, which waits for its states; the present settings apply to it.

        stamp_ns : start of exposure
        payload : is returned with the match
        now_s : time of reception on a monotonic clock, seconds
        """
        self._image_count += 1
        image = _WaitingImage(stamp_ns, self._image_count, now_s, payload, self.settings)
        insort(self._waiting, image)

    def drop_oldest(self) -> FrameMatch:
        """Remove the waiting image with the oldest stamp."""
        image = self._waiting.pop(0)
        return FrameMatch(payload=image.payload, stamp_ns=image.stamp_ns, reason='waited too long')

    def pop_matches(self, now_s: float = math.inf, timeout_s: float = 0.0) -> Iterator[FrameMatch]:
        """
        Yield matched images by stamp, up to the first one that still waits for states.

        now_s : present time on the clock of ``add_image``
        timeout_s : an image for which no state has arrived in this time is matched with the
            known ones
        """
        while self._waiting:
            image = self._waiting[0]
            if now_s - self._waiting_since_s(image) < timeout_s:
                return
            del self._waiting[0]
            is_repeated = image.stamp_ns == self._matched_ns
            self._matched_ns = image.stamp_ns
            yield _repeated(image) if is_repeated else self._match(image)

    def _waiting_since_s(self, image: _WaitingImage) -> float:
        """
        Return when the last state arrived that the image waits for; -inf where it waits for none.

        In step motion the table must be known to the end of the exposure.
        """
        stamp_ns, settings = image.stamp_ns, image.settings
        end_ns = stamp_ns + int(settings.exposure * NANOSECONDS)
        needed_ns = end_ns if settings.motion == 'step' else stamp_ns
        table, lasers = self._joint_history.stamps_ns, self._laser_history.stamps_ns
        since_s = -math.inf
        is_known = bool(table) and self._joint_history.confirmed_ns >= needed_ns
        if not is_known or not table[0] <= stamp_ns:
            since_s = _last_received_s(image, table, self._table_received_s)
        if not settings.always_on and (not lasers or lasers[-1] < end_ns):
            since_s = max(since_s, _last_received_s(image, lasers, self._lasers_received_s))
        return since_s

    def _match(self, image: _WaitingImage) -> FrameMatch:
        stamp_ns, settings = image.stamp_ns, image.settings
        laser, reason = self._laser_during(image)
        if not self._joint_history.covers(stamp_ns):
            reason = 'no angle'
        elif fault := self._joint_history.fault_at(stamp_ns):
            reason = fault
        elif laser is not None and settings.view_of(laser) < 0:
            reason = NOT_MEASURED
        elif not reason and settings.motion == 'step':
            reason = self._step_refusal(image, settings.view_of(laser or 0))
        if reason == LASER_OFF and settings.dark and self._at_standstill(image):
            angle = self._joint_history.position_at(stamp_ns)
            self._dark = DarkFrame(payload=image.payload, stamp_ns=stamp_ns, angle=angle)
        if reason or laser is None:
            return self._unused(image, reason, laser)
        angle = self._joint_history.position_at(stamp_ns)
        if self._turns is None:
            # single precision cannot hold the angle of a table that has made many turns
            self._turns = _TURN * round(angle / _TURN)
        match = FrameMatch(
            payload=image.payload,
            stamp_ns=stamp_ns,
            angle=float(np.float32(angle - self._turns)),
            speed=float(np.float32(self._joint_history.velocity_at(stamp_ns))),
            laser=laser,
            view=settings.view_of(laser),
            dark=self._dark_frame_at(angle) if settings.dark else None,
        )
        if settings.exposures > 1:
            match = self._bracketed(match, settings)
        if not match.reason:
            self._measured_angles[match.view] = angle
        return match

    def _unused(self, image: _WaitingImage, reason: str, laser: int | None) -> FrameMatch:
        """Return an image that becomes no profile; that of a known laser or none has its angle."""
        at, angle, turns = image.stamp_ns, math.nan, self._turns
        if reason in _AT_ANGLE or (reason == LASER_OFF and turns is not None):
            angle = self._joint_history.position_at(at) - (turns or 0.0)
        return FrameMatch(
            payload=image.payload, stamp_ns=at, reason=reason, angle=angle, laser=laser or 0
        )

    def _bracketed(self, match: FrameMatch, settings: MatchSettings) -> FrameMatch:
        """Return the last exposure of a position with the others, and for these a reason."""
        earlier = self._brackets.get(match.view, [])
        if earlier and abs(earlier[0].angle - match.angle) >= settings.min_step:
            # the table went on before all exposures were taken
            earlier = []
        if len(earlier) + 1 < settings.exposures:
            self._brackets[match.view] = [*earlier, match]
            return replace(match, reason=OTHER_EXPOSURE)
        self._brackets[match.view] = []
        return replace(match, bracket=tuple(earlier))

    def _laser_during(self, image: _WaitingImage) -> tuple[int | None, str]:
        if image.settings.always_on:
            return 0, ''
        delay_ns = int(image.settings.stamp_delay * NANOSECONDS)
        exposure_ns = int(image.settings.exposure * NANOSECONDS)
        begin_ns = image.stamp_ns - delay_ns
        return self._laser_history.laser_during(begin_ns, delay_ns + exposure_ns)

    def _at_standstill(self, image: _WaitingImage) -> bool:
        stamp_ns, settings = image.stamp_ns, image.settings
        begin_ns = stamp_ns - int((settings.settle + settings.stamp_delay) * NANOSECONDS)
        end_ns = stamp_ns + int(settings.exposure * NANOSECONDS)
        return self._joint_history.travel(begin_ns, end_ns) <= settings.stand

    def _dark_frame_at(self, angle: float) -> DarkFrame | None:
        dark = self._dark
        return dark if dark and abs(dark.angle - angle) < self.settings.min_step else None

    def _step_refusal(self, image: _WaitingImage, view: int) -> str:
        """Return why an image is not used in step motion, '' where it is."""
        if not self._at_standstill(image):
            return 'table moving'
        previous = self._measured_angles.get(view, math.inf)
        angle = self._joint_history.position_at(image.stamp_ns)
        return SAME_POSITION if abs(angle - previous) < image.settings.min_step else ''


def _repeated(image: _WaitingImage) -> FrameMatch:
    return FrameMatch(payload=image.payload, stamp_ns=image.stamp_ns, reason=SAME_STAMP)


def _last_received_s(image: _WaitingImage, stamps_ns: Sequence[int], received_s: float) -> float:
    """Return when the image or a state that can still reach its stamp was received, seconds."""
    is_before_all = bool(stamps_ns) and image.stamp_ns < stamps_ns[0]
    is_other_clock = bool(stamps_ns) and image.stamp_ns > stamps_ns[-1] + _OTHER_CLOCK_NS
    # further states never reach an image that is older than all of them, or of another clock
    if is_before_all or is_other_clock:
        return image.received_s
    return max(image.received_s, received_s)
