# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Interlock of the lasers: which one may be on, from keep-alive, permit and manual requests."""

from collections.abc import Callable
from collections.abc import Sequence
from dataclasses import dataclass
import math
import threading
import time

from ivfmc_ros.errors import BusyError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.validation import require_in_range

Clock = Callable[[], float]

# Seconds after an interruption in which a request that begins again is the old one.
_RELEASE_TIME = 2.0


@dataclass(frozen=True, kw_only=True)
class BeamSettings:
    """
    Conditions under which a laser may be on.

    hold_timeout : seconds after the last beam_hold until all lasers go off
    limit : seconds that a laser may be on by a manual request
    permit_required : no laser is on unless beam_permit is true
    permit_timeout : seconds that a permit is valid, 0 for until it is withdrawn
    """

    hold_timeout: float = 0.5
    limit: float = 10.0
    permit_required: bool = False
    permit_timeout: float = 0.0

    def __post_init__(self) -> None:
        require_in_range('hold_timeout', self.hold_timeout, 0.1, 5.0, 's')
        require_in_range('limit', self.limit, 0.0, 600.0, 's')
        require_in_range('permit_timeout', self.permit_timeout, 0.0, 600.0, 's')


@dataclass(frozen=True, kw_only=True)
class Beam:
    """
    The decision of the interlock.

    laser : name of the laser that should be on, None for none
    urgent : a laser that is on now must go off even if that stops a moving table
    reason : why no laser may be on, '' otherwise
    """

    laser: str | None
    urgent: bool
    reason: str


class BeamInterlock:
    """
    Decides which laser should be on. Thread safe; no method waits.

    lasers : names of the lasers
    settings : may be replaced at any time
    clock : returns steady seconds
    """

    def __init__(
        self, lasers: Sequence[str], settings: BeamSettings, clock: Clock = time.monotonic
    ) -> None:
        self._lasers = tuple(lasers)
        self.settings = settings
        self._clock = clock
        self._lock = threading.Lock()
        self._held: str | None = None
        self._held_at = -math.inf
        self._blocked: str | None = None  # stays off after a stop until it is released
        self._interrupted_at = -math.inf  # when its end stopped a moving table
        self._manual: str | None = None
        self._manual_until = -math.inf
        self._permitted_at = -math.inf

    @property
    def hold_active(self) -> bool:
        """Whether a beam_hold arrived within ``hold_timeout``: a scan wants images."""
        return self._clock() - self._held_at <= self.settings.hold_timeout

    def hold(self, name: str) -> None:
        """
        Request one laser for another ``hold_timeout``; '' requests none.

        :raises ParameterError: there is no such laser; all go off then
        """
        with self._lock:
            known = name in self._lasers
            quiet = max(self._held_at, self._interrupted_at + _RELEASE_TIME)
            released = self._clock() - quiet > self.settings.hold_timeout
            if released or name != self._blocked:
                self._blocked = None
            self._held_at, self._held = self._clock(), name if known else None
            self._manual = None
        if name and not known:
            raise ParameterError(
                f'beam_hold: there is no laser {name!r}; the lasers are: {self._known}'
            )

    def permit(self, allowed: bool) -> None:
        """Grant the permit, or withdraw it."""
        with self._lock:
            self._permitted_at = self._clock() if allowed else -math.inf

    def enable(self, name: str, on: bool, moving: bool) -> None:
        """
        Turn a laser on by a manual request, for at most ``limit`` seconds, or off.

        moving : whether the table moves
        :raises BusyError: a scan runs, the table moves, or there is no permit
        :raises ParameterError: there is no such laser
        """
        if name not in self._lasers:
            raise ParameterError(
                f'enable: there is no laser {name!r}; the lasers are: {self._known}'
            )
        with self._lock:
            if not on:
                self._manual = None if self._manual == name else self._manual
                return
            if self.hold_active or moving:
                raise BusyError(
                    f'{name}/enable: works in an idle cell only; cancel the scan first'
                )
            if not self._permitted:
                raise BusyError(f'{name}/enable: beam_permit is required but was not granted')
            self._manual, self._manual_until = name, self._clock() + self.settings.limit

    def end_manual(self) -> None:
        """Turn off a laser that was turned on by a manual request."""
        with self._lock:
            self._manual = None

    def block(self) -> None:
        """Keep the requested laser off, after a stop, until its request ends or changes."""
        with self._lock:
            self._manual = None
            self._blocked = self._held if self.hold_active else None

    def interrupt(self) -> None:
        """
        Keep the requested laser off after its end stopped a moving table.

        The laser would shine on a standing table if its request began again. It is released by a
        request of none or of another laser, or when nothing was requested for some time.
        """
        with self._lock:
            self._manual = None
            self._blocked, self._interrupted_at = self._held, self._clock()

    def decide(self) -> Beam:
        """Return which laser should be on now."""
        with self._lock:
            if not self._permitted:
                return Beam(laser=None, urgent=True, reason='beam_permit is not granted')
            if self.hold_active:
                if self._held is not None and self._held == self._blocked:
                    return Beam(laser=None, urgent=True, reason='stopped')
                return Beam(laser=self._held, urgent=False, reason='')
            if self._manual is not None and self._clock() < self._manual_until:
                return Beam(laser=self._manual, urgent=False, reason='')
            self._manual = None
            return Beam(laser=None, urgent=True, reason='no beam_hold')

    @property
    def _permitted(self) -> bool:
        settings = self.settings
        if not settings.permit_required:
            return True
        validity = settings.permit_timeout or math.inf
        return self._permitted_at > -math.inf and self._clock() - self._permitted_at <= validity

    @property
    def _known(self) -> str:
        return ', '.join(self._lasers) or 'none'
