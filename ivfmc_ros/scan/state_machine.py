# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""State machine of a scan: its stage, the allowed transitions, pause and cancel requests."""

from collections.abc import Callable
from enum import StrEnum

from ivfmc_ros.errors import CancelledError
from ivfmc_ros.errors import StateError


class Stage(StrEnum):
    """The stages of a scan, by the names that the topic ``scan_status`` publishes."""

    IDLE = 'IDLE'
    PREPARING = 'PREPARING'
    SCANNING = 'SCANNING'
    PAUSED = 'PAUSED'
    REGISTERING = 'REGISTERING'
    MESHING = 'MESHING'
    INSPECTING = 'INSPECTING'
    FINISHING = 'FINISHING'
    DONE = 'DONE'
    FAILED = 'FAILED'
    CANCELLED = 'CANCELLED'


# The final stages; none follows them.
FINAL_STAGES = (Stage.DONE, Stage.FAILED, Stage.CANCELLED)

_NEXT_STAGES: dict[Stage, tuple[Stage, ...]] = {
    Stage.IDLE: (Stage.PREPARING,),
    Stage.PREPARING: (Stage.SCANNING,),
    Stage.SCANNING: (Stage.PAUSED, Stage.REGISTERING),
    Stage.PAUSED: (Stage.SCANNING,),
    Stage.REGISTERING: (Stage.MESHING,),
    Stage.MESHING: (Stage.INSPECTING, Stage.FINISHING),
    Stage.INSPECTING: (Stage.FINISHING,),
    Stage.FINISHING: (Stage.DONE,),
    Stage.DONE: (),
    Stage.FAILED: (),
    Stage.CANCELLED: (),
}


class StateMachine:
    """
    The state of one scan.

    It stores requests to pause, resume and cancel; ``run_job`` reads them between its steps.
    """

    def __init__(self, on_change: Callable[[Stage], None] = lambda stage: None) -> None:
        """
        Start in IDLE.

        on_change : is called with the new stage after every transition
        """
        self.stage = Stage.IDLE
        self._on_change = on_change
        self._pause_requested = False
        self._cancel_requested = False
        self._ending = False

    @property
    def running(self) -> bool:
        """Whether the scan has begun and not ended."""
        return self.stage is not Stage.IDLE and self.stage not in FINAL_STAGES

    @property
    def pause_requested(self) -> bool:
        """Whether the scan has to pause before its next sweep or stop."""
        return self._pause_requested

    def advance(self, stage: Stage) -> None:
        """
        Go to the next stage.

        :raises StateError: the present stage has no transition to it
        """
        allowed = _NEXT_STAGES[self.stage]
        # every running stage can fail and can be cancelled
        if self.running:
            allowed = (*allowed, Stage.FAILED, Stage.CANCELLED)
        if stage not in allowed:
            raise StateError(f'{stage} cannot follow {self.stage}')
        self.stage = stage
        self._on_change(stage)

    def pause(self) -> None:
        """
        Request a pause.

        :raises StateError: the scan takes no profiles any more, or is ending
        """
        self._require_open()
        if self.stage not in (Stage.IDLE, Stage.PREPARING, Stage.SCANNING, Stage.PAUSED):
            raise StateError(f'a scan can be paused while it takes profiles, it is {self.stage}')
        self._pause_requested = True

    def resume(self) -> None:
        """
        Withdraw the request to pause.

        :raises StateError: the scan is not paused and no pause is requested
        """
        self._require_open()
        if self.stage in FINAL_STAGES or not self._pause_requested:
            raise StateError(f'no scan is paused; the last one is {self.stage}')
        self._pause_requested = False

    def cancel(self) -> None:
        """
        Request the end of the scan.

        A scan that was accepted can be cancelled before its first step.

        :raises StateError: the scan has ended, or only its report is still being written
        """
        self._require_open()
        if self.stage in FINAL_STAGES:
            raise StateError(f'no scan is running; the last one is {self.stage}')
        if self.stage is Stage.FINISHING:
            raise StateError('the mesh is complete; the scan ends when its report is written')
        self._cancel_requested = True

    def refuse_requests(self) -> None:
        """Refuse pause, resume and cancel from now on: the scan has failed and is ending."""
        self._ending = True

    def _require_open(self) -> None:
        if self._ending:
            raise StateError(f'the scan failed or was cancelled while {self.stage}, and is ending')

    def raise_if_cancelled(self) -> None:
        """:raises CancelledError: the end of the scan has been requested."""
        if self._cancel_requested:
            raise CancelledError('the scan was cancelled')
