# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""At which stage a scan is, and which stages can follow."""

from collections.abc import Callable
from enum import StrEnum

from ivfmc_ros.errors import CancelledError
from ivfmc_ros.errors import StateError


class Stage(StrEnum):
    """The stages of a scan, by the names that ``scan_status`` tells."""

    IDLE = 'IDLE'
    PREPARING = 'PREPARING'
    SCANNING = 'SCANNING'
    PAUSED = 'PAUSED'
    REGISTERING = 'REGISTERING'
    MESHING = 'MESHING'
    FINISHING = 'FINISHING'
    DONE = 'DONE'
    FAILED = 'FAILED'
    CANCELLED = 'CANCELLED'


ENDS = (Stage.DONE, Stage.FAILED, Stage.CANCELLED)

_AFTER: dict[Stage, tuple[Stage, ...]] = {
    Stage.IDLE: (Stage.PREPARING,),
    Stage.PREPARING: (Stage.SCANNING,),
    Stage.SCANNING: (Stage.PAUSED, Stage.REGISTERING),
    Stage.PAUSED: (Stage.SCANNING,),
    Stage.REGISTERING: (Stage.MESHING,),
    Stage.MESHING: (Stage.FINISHING,),
    Stage.FINISHING: (Stage.DONE,),
    Stage.DONE: (),
    Stage.FAILED: (),
    Stage.CANCELLED: (),
}


class Machine:
    """
    The state of one scan. Requests to pause, resume and cancel are noted here; the job obeys.

    changed : is called after every change of the stage
    """

    def __init__(self, changed: Callable[[Stage], None] = lambda stage: None) -> None:
        self.stage = Stage.IDLE
        self._changed = changed
        self._pause = False
        self._cancel = False

    @property
    def running(self) -> bool:
        """Whether the scan has begun and not ended."""
        return self.stage is not Stage.IDLE and self.stage not in ENDS

    @property
    def pausing(self) -> bool:
        """Whether the scan shall wait as soon as it can."""
        return self._pause

    @property
    def cancelling(self) -> bool:
        """Whether the scan shall end."""
        return self._cancel

    def advance(self, stage: Stage) -> None:
        """
        Go to the next stage.

        :raises StateError: it does not follow on the present one
        """
        allowed = _AFTER[self.stage]
        # whatever runs can fail and can be cancelled
        if self.running:
            allowed = (*allowed, Stage.FAILED, Stage.CANCELLED)
        if stage not in allowed:
            raise StateError(f'{stage} cannot follow {self.stage}')
        self.stage = stage
        self._changed(stage)

    def pause(self) -> None:
        """:raises StateError: the scan is not taking profiles."""
        if self.stage not in (Stage.PREPARING, Stage.SCANNING, Stage.PAUSED):
            raise StateError(f'a scan can be paused while it takes profiles, it is {self.stage}')
        self._pause = True

    def resume(self) -> None:
        """:raises StateError: the scan neither is paused nor about to be."""
        if not self.running or not self._pause:
            raise StateError(f'no scan is paused; the last one is {self.stage}')
        self._pause = False

    def cancel(self) -> None:
        """:raises StateError: nothing runs."""
        if not self.running:
            raise StateError(f'no scan is running; the last one is {self.stage}')
        self._cancel = True

    def check(self) -> None:
        """:raises CancelledError: the scan shall end."""
        if self._cancel:
            raise CancelledError('the scan was cancelled')
