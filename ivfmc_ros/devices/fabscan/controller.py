# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Motion controller with the firmware of FabScan Pi: a stepper motor and two lasers.

Source: github.com/mariolukas/FabScanPi-Firmware. It echoes each line, executes it, and sends a
prompt (``>``); nothing is answered, and no laser switched, during a move (``G02``), which ramps up
and down. It reports no position, so the driver counts steps: a move whose prompt is lost is a lost
position. A move is sent in pieces, between which it can be stopped.
"""

from collections.abc import Mapping
import re
import time

import serial

from ivfmc_ros.devices.motion import trajectory
from ivfmc_ros.devices.prompt.controller import PromptController
from ivfmc_ros.errors import ControllerLostError
from ivfmc_ros.errors import DeviceError

# Fixed in the firmware: steps per second and per second squared of ``G02``.
_MAX_SPEED, _ACCELERATION = 3000.0, 500.0
# Steps of a piece of a move: it takes a second, which is how long a stop may take.
_PIECE_STEPS = 125
_START_S = 2.5  # seconds that a boot loader takes; the firmware does not greet
_ANSWER_S = 1.0  # seconds after the end of a move in which its prompt comes
_PERIOD_S = 0.02  # seconds between looks at the motion
_ALIVE_PERIOD_S = 1.0  # seconds between questions to a controller that stands
_PROMPT = '>'
_VERSION = re.compile(r'v?\d+[.\w+-]*', re.ASCII)
# Echo of a command, and an empty line.
_ECHO = re.compile(r'(?:[GM]\d+[ ;\w.-]*)?', re.ASCII)


class FabscanController(PromptController):
    """A MotionController with the firmware of FabScan Pi; its units are steps."""

    OUTPUTS: Mapping[str, tuple[str, str]] = {
        # in the order of FabScan's server: the first laser is the right one
        'laser1': ('M21', 'M22'),
        'laser2': ('M19', 'M20'),
    }
    # executed at the end of a piece of a move, not earlier
    OFF_STEPS = ((b'\nM20\nM22\n', 0.0),)

    def _is_end(self, text: str) -> bool:
        return text == _PROMPT

    def _is_busy(self, text: str) -> bool:
        return False

    def _handle_line(self, text: str) -> None:
        known = text == _PROMPT or _ECHO.fullmatch(text) or _VERSION.fullmatch(text)
        if not known:
            self._unknown.add(text)

    def adopt(self, port: serial.Serial, received: bytes) -> None:
        """Use an open port for the next ``open``; prompts that were received answer nothing."""
        super().adopt(port, b'')

    def _connect(self) -> None:
        self._goal: int | None = None
        self._asked_at = 0.0
        # a line that was cut off is ended; a boot loader may swallow this
        deadline = time.monotonic() + _START_S
        while True:
            try:
                answer = self._line.request('M200', seconds=0.5, attempts=1)
                break
            except ControllerLostError:
                if time.monotonic() > deadline:
                    raise
        versions = [line for line in answer if _VERSION.fullmatch(line)]
        if not versions:
            raise ControllerLostError(
                f'port {self._settings.port}: M200 names no version; received: {answer[:3]}'
            )
        self._firmware = f'FabScan {versions[-1]}'
        self._limits = _MAX_SPEED, _ACCELERATION
        self._line.request('M17')
        # what it counts from is where it stands
        self._steps = round(self._estimator.target)
        self._stand(self._steps)

    def _begin(self, target: float, velocity: float, acceleration: float) -> None:
        with self._changed:
            self._goal = round(target)
            # a motion is in progress from now on
            plan = self._trapezoid(self._goal, _MAX_SPEED, _ACCELERATION)
            if len(plan) > 1:
                self._plan(plan)

    def _halt(self) -> None:
        self._goal = None
        with self._command_lock:
            while not self._estimator.standing and self._alarm is None:
                time.sleep(_PERIOD_S)

    def _work(self) -> None:
        with self._changed:
            goal, standing = self._goal, self._estimator.standing
        if goal is None or self._steps == goal or self._alarm is not None:
            if not standing:
                self._stand(self._steps)
            self._ask_alive()
            return
        piece = max(-_PIECE_STEPS, min(_PIECE_STEPS, goal - self._steps))
        self._turn(piece)
        if self._goal in (None, self._steps):
            self._stand(self._steps)

    def _turn(self, piece: int) -> None:
        """Turn by some steps; a lost prompt is a lost position."""
        plan = trajectory.trapezoid(
            self._steps, self._steps + piece, _MAX_SPEED, _ACCELERATION, 0.0
        )
        self._plan(plan)
        seconds = trajectory.end_time(plan) + _ANSWER_S
        try:
            self._line.request(f'G02 T{piece} F{_MAX_SPEED:.0f}', seconds=seconds, attempts=1)
        except DeviceError:
            self._goal = None
            self._lose_position()
            raise
        self._steps += piece
        self._asked_at = time.monotonic()
        with self._changed:
            self._reported, self._reported_ns = self._steps, time.time_ns()

    def _ask_alive(self) -> None:
        now = time.monotonic()
        if now - self._asked_at > _ALIVE_PERIOD_S:
            self._asked_at = now
            self._line.request('M200')
