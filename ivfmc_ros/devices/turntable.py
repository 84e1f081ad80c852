# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A motion board and the rules for its lasers, in threads that no callback can hold up."""

from collections.abc import Callable
import contextlib
import math
import threading
import time

from ivfmc_ros.devices.beam import Beam
from ivfmc_ros.devices.beam import BeamKeeper
from ivfmc_ros.devices.beam import BeamRules
from ivfmc_ros.devices.controller import BoardState
from ivfmc_ros.devices.controller import MotionBoard
from ivfmc_ros.errors import DeviceError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import StoppedError

_LOOK = 0.02  # seconds from look to look of the guard
_RETRY = 2.0  # seconds from one attempt to connect, or to switch, to the next
_NEAR = 1e-6  # radians
_SWITCHING = 2.0  # seconds that a board may take to turn a laser off
_GLANCE = 0.005  # seconds from look to look while a move waits for that


class TurntableDriver:
    """
    Keeps the board connected and its lasers as the keeper wants them.

    The guard looks 50 times a second and cuts a beam that nobody vouches for. Lasers are
    switched by another thread, because that waits for the end of a motion on many boards.
    """

    def __init__(self, board: MotionBoard, beam: BeamKeeper, *, velocity: float) -> None:
        """
        Begin with nothing; ``start`` connects.

        velocity : radians per second, of a move that says nothing of its time, and the limit
        """
        self._board, self._beam, self._velocity = board, beam, velocity
        self._closing = threading.Event()
        self._look = threading.Event()
        self._connected = False
        self._wanted: str | None = None
        self._switching = threading.Condition()
        self._target: tuple[float, float] | None = None
        self._moving = threading.Condition()
        self._threads: list[threading.Thread] = []
        self.trouble = 'not connected yet'
        self.refused = ''

    def start(self) -> None:
        """Connect, in the background, and again until it succeeds."""
        self._closing.clear()
        for function in (self._guard, self._switch, self._move):
            thread = threading.Thread(
                target=self._keep, args=(function,), name=function.__name__, daemon=True
            )
            thread.start()
            self._threads.append(thread)

    def close(self) -> None:
        """Turn the lasers off, stop the table, disconnect; may be called again."""
        self._closing.set()
        self._board.close()
        for thread in self._threads:
            thread.join()
        self._threads.clear()
        if self._connected:
            # a connection that came about while this one was closed
            self._board.close()
        self._connected = False

    def adjust(self, rules: BeamRules, velocity: float, power: float) -> None:
        """Go by other limits from now on; the power (0 to 1) when a laser is turned on next."""
        self._beam.rules, self._velocity = rules, velocity
        self._board.set_power(power)

    def state(self) -> BoardState:
        """Return what is known now, without waiting."""
        return self._board.poll()

    def command(self, position: float, seconds: float) -> None:
        """
        Have the table go to a position, without waiting; the last command counts.

        ``refused`` says why the board did not take it.

        position : radians, unwrapped
        seconds : that it shall take, 0 for as fast as is allowed; it takes longer if it must
        :raises ParameterError: a number is not finite
        """
        if not (math.isfinite(position) and math.isfinite(seconds) and seconds >= 0.0):
            raise ParameterError(f'position {position}, seconds {seconds}: must be finite')
        with self._moving:
            self._target = position, seconds
            self._moving.notify_all()

    def go_to(self, position: float, seconds: float) -> None:
        """
        Begin a move that ends in standstill; return when the board has accepted it.

        :raises DeviceError: the board did not
        """
        self._beam.idle()
        self._await_darkness()
        limits = self._board.limits()
        speed = min(self._velocity, limits.velocity)
        way = abs(position - self._board.poll().position)
        if seconds > 0.0 and way > _NEAR:
            speed = min(speed, cruise_speed(way, seconds, limits.acceleration))
        self._board.move_to(position, speed, limits.acceleration)

    def _await_darkness(self) -> None:
        """Let a laser that shall go out do so first; under way, the table would be stopped."""
        end = time.monotonic() + _SWITCHING
        while self._beam.decide().laser is None and time.monotonic() < end:
            state = self._board.poll()
            if state.moving or state.alarm is not None or lit_laser(state) is None:
                return
            self._closing.wait(_GLANCE)

    def hold(self, laser: str) -> None:
        """
        Keep one laser on for another while; '' is none.

        :raises ParameterError: there is no such laser
        """
        try:
            self._beam.hold(laser)
        finally:
            self._look.set()

    def permit(self, allowed: bool) -> None:
        """Permit beams, or forbid them."""
        self._beam.permit(allowed)
        self._look.set()

    def home(self) -> None:
        """Home the table, which finds its position again."""
        self._beam.idle()
        self._board.home()

    def stop(self) -> None:
        """Brake, lasers off; they stay off until whoever holds them has let go."""
        with self._moving:
            self._target = None
        self._beam.stopped()
        self._board.stop()

    def clear_alarm(self) -> None:
        """Take commands again; connects again to a lost board."""
        self._beam.stopped()
        self._board.clear_alarm()
        self._connected = True

    def enable(self, name: str, on: bool) -> None:
        """
        Turn a laser on or off by hand; return when it is so.

        :raises DeviceError: the board did not do it
        """
        self._beam.enable(name, on, self._board.poll().moving)
        laser = self._beam.decide().laser
        with self._switching:
            self._wanted = laser
        self._board.set_laser(laser)

    # -- threads

    def _keep(self, work: Callable[[], None]) -> None:
        """Let a thread go on whatever it raises: a guard that ended would cut no beam."""
        while not self._closing.is_set():
            try:
                work()
            except Exception as error:
                self.trouble = f'{type(error).__name__}: {error}'
                self._closing.wait(_LOOK)

    def _guard(self) -> None:
        retry_at = 0.0
        while not self._closing.is_set():
            self._look.wait(_LOOK)
            self._look.clear()
            now = time.monotonic()
            if not self._connected:
                if now >= retry_at:
                    self._connect()
                    retry_at = time.monotonic() + _RETRY
                continue
            beam, state = self._beam.decide(), self._board.poll()
            lit = any(state.lasers.values())
            with self._switching:
                self._wanted = beam.laser
                self._switching.notify_all()
            if self._must_cut(beam, state, lit) and now >= retry_at:
                retry_at = now + (0.0 if self._cut() else _RETRY)

    def _must_cut(self, beam: Beam, state: BoardState, lit: bool) -> bool:
        if state.alarm is not None:
            return lit and state.alarm not in ('BOARD_LOST', 'CONNECTING')
        # a table that stands is no hurry: the other thread turns the laser off
        return lit and beam.urgent and state.moving

    def _connect(self) -> None:
        try:
            self._board.open()
        except DeviceError as error:
            self.trouble = str(error)
        else:
            self.trouble, self._connected = '', True

    def _cut(self) -> bool:
        try:
            self._board.stop()
        except DeviceError as error:
            self.trouble = str(error)
            return False
        return True

    def _move(self) -> None:
        while not self._closing.is_set():
            with self._moving:
                self._moving.wait_for(lambda: self._target is not None, _LOOK)
                target, self._target = self._target, None
            if target is None:
                continue
            try:
                self.go_to(*target)
                self.refused = ''
            except DeviceError as error:
                self.refused = str(error)

    def _switch(self) -> None:
        while not self._closing.is_set():
            with self._switching:
                self._switching.wait(_LOOK)
                wanted = self._wanted
            state = self._board.poll()
            ready = self._connected and state.alarm is None
            if not ready or wanted == lit_laser(state):
                continue
            try:
                self._board.set_laser(wanted)
                self.trouble = ''
            except StoppedError:
                pass  # which has turned all off
            except DeviceError as error:
                self.trouble = str(error)
                # what went wrong once, and left the laser on, must not go wrong again
                if wanted is None:
                    with contextlib.suppress(DeviceError):
                        self._board.stop()
                self._closing.wait(_LOOK)


def lit_laser(state: BoardState) -> str | None:
    """Return the laser that is on; '' if several are, None if none is."""
    lit = [name for name, on in state.lasers.items() if on]
    return None if not lit else lit[0] if len(lit) == 1 else ''


def cruise_speed(way: float, seconds: float, acceleration: float) -> float:
    """
    Return the speed of a move of ``way`` that takes ``seconds`` from standstill to standstill.

    Infinite if no speed is high enough.
    """
    root = (acceleration * seconds) ** 2 - 4 * acceleration * way
    if root < 0.0:
        return math.inf
    # the smaller root of v^2 - a t v + a w = 0, in the form that does not cancel
    return 2 * way / (seconds + math.sqrt(root) / acceleration)
