# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The node of the motion board: table, lasers, and the rules for beams."""

from collections.abc import Sequence
from pathlib import Path
import re
from typing import Any

from rclpy.lifecycle import LifecycleState
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from std_msgs.msg import Header
from std_srvs.srv import SetBool
from trajectory_msgs.msg import JointTrajectory

from ivfmc_ros.devices.beam import BeamKeeper
from ivfmc_ros.devices.beam import BeamRules
from ivfmc_ros.devices.controller import BoardState
from ivfmc_ros.devices.grbl.controller import GrblBoard
from ivfmc_ros.devices.grbl.settings import GrblSettings
from ivfmc_ros.devices.grbl.settings import OUTPUTS
from ivfmc_ros.devices.turntable import TurntableDriver
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import StateError
from ivfmc_ros.nodes.framework.base import run
from ivfmc_ros.nodes.framework.health import Level
from ivfmc_ros.nodes.framework.json_response import Answer
from ivfmc_ros.nodes.framework.lifecycle import LifecycleCellNode

_LASER_PERIOD_NS = 100_000_000
# alarms in which nothing is known of the position
_SILENT = ('BOARD_LOST', 'CONNECTING')
# <laser>/enable is a service
_NAME = re.compile(r'[A-Za-z][A-Za-z0-9_]*')
_OLD_NS = 1_000_000_000  # a keep-alive that was so long on its way vouches for nothing


class TurntableNode(LifecycleCellNode):
    """Converts between topics and a TurntableDriver."""

    def __init__(self) -> None:
        super().__init__('turntable')
        self._driver: TurntableDriver | None = None
        self._declare_board()
        self._declare_beam()
        self._lasers = [name for name in self.get('lasers') if name]
        self._joint = str(self.get('joint'))
        self._outputs = [name for name in self.get('laser_outputs') if name]
        _require_names(self._lasers)
        self._settings()
        self._rules()
        self.check(self._require_same_wiring)
        self.changed(self._adjust)
        self._lasers_ns, self._lasers_said_ns = 0, 0
        self._laser_states = self.publish_on(JointState, 'laser_states')
        self.subscribe(Header, 'beam_hold', self._hold)
        self.subscribe(Bool, 'beam_permit', self._permit)
        if self.get('table'):
            self._joint_states = self.publish_on(JointState, 'joint_states')
            self.subscribe(JointTrajectory, 'joint_trajectory', self._joint_trajectory)
            self.trigger('home', self._home)
        self.trigger('stop', self._stop)
        self.trigger('clear_alarm', self._clear_alarm)
        for laser in self._lasers:
            self.service(SetBool, f'{laser}/enable', self._enabler(laser))
        self.steady_timer(1 / self.get('joint_rate'), self._publish)

    # -- lifecycle

    def on_configure(self, state: LifecycleState) -> None:
        """Check what the parameters say of the board."""
        self._settings()
        if not self.get('port'):
            raise ParameterError('port: name the serial port of the board, such as /dev/ttyACM0')

    def on_activate(self, state: LifecycleState) -> Any:
        """Connect in the background: a board takes seconds to start."""
        self._driver = TurntableDriver(
            GrblBoard(self._settings()),
            BeamKeeper(self._lasers, self._rules()),
            velocity=self.get('velocity'),
        )
        self._driver.start()
        return super().on_activate(state)

    def let_go(self) -> None:
        """Lasers off, table stopped, board let go."""
        driver, self._driver = self._driver, None
        if driver is not None:
            driver.close()

    # -- parameters

    def _declare_board(self) -> None:
        fixed: dict[str, Any] = {'read_only': True}
        say = self.parameter
        say('port', '', 'Serial port of the board, or a pyserial URL.', **fixed)
        say('baud', 115200, 'Of the serial port.', low=1200, high=4_000_000, **fixed)
        say('axis', 'X', 'Letter of the axis that turns the table.', choices='XYZABC', **fixed)
        say(
            'units_per_turn',
            360.0,
            'Board units of a turn; negative if positive is clockwise seen from above.',
            low=-1e6,
            high=1e6,
            **fixed,
        )
        say('table', True, 'The board turns a table; false: it has lasers only.', **fixed)
        say('joint', 'turntable_joint', 'Name of the joint.', **fixed)
        say('joint_rate', 60.0, 'joint_states a second.', low=1.0, high=500.0, **fixed)
        say('velocity', 2.0, 'Greatest velocity of the table, rad/s.', low=0.001, high=100.0)

    def _declare_beam(self) -> None:
        fixed: dict[str, Any] = {'read_only': True}
        say = self.parameter
        say('lasers', ['left', 'right'], 'Names of the lasers, as in cell.yaml.')
        say(
            'laser_outputs',
            ['spindle', 'coolant'],
            'What each laser is wired to: spindle (M3, M5) or coolant (M8, M9).',
        )
        say('laser_power', 1.0, 'Of a laser on the spindle, 0 to 1.', low=0.0, high=1.0)
        say('beam_hold_timeout', 0.5, 'Seconds without beam_hold until dark.', low=0.1, high=5.0)
        say('beam_limit', 10.0, 'Seconds that a laser is on by hand.', low=0.0, high=600.0)
        say('beam_permit_required', False, 'Nothing shines without beam_permit.', **fixed)
        say(
            'beam_permit_timeout',
            0.0,
            'Seconds that a permit is good for; 0: until it is taken away.',
            low=0.0,
            high=600.0,
        )

    def _settings(self) -> GrblSettings:
        if len(self._outputs) != len(self._lasers):
            raise ParameterError(
                f'laser_outputs: {len(self._outputs)} for {len(self._lasers)} lasers; '
                f'each needs one of {", ".join(OUTPUTS)}'
            )
        return GrblSettings(
            port=_port(self.get('port')),
            baud=self.get('baud'),
            axis=self.get('axis'),
            units_per_turn=self.get('units_per_turn'),
            lasers=dict(zip(self._lasers, self._outputs, strict=True)),
            power=self.get('laser_power'),
        )

    def _require_same_wiring(self, values: Any) -> None:
        wiring = ([name for name in values[key] if name] for key in ('lasers', 'laser_outputs'))
        if list(wiring) != [self._lasers, self._outputs]:
            raise ParameterError('lasers, laser_outputs: are set when the node is started')

    def _rules(self) -> BeamRules:
        return BeamRules(
            hold_timeout=self.get('beam_hold_timeout'),
            limit=self.get('beam_limit'),
            permit_required=self.get('beam_permit_required'),
            permit_timeout=self.get('beam_permit_timeout'),
        )

    def _adjust(self, _: set[str]) -> None:
        if self._driver is not None:
            self._driver.adjust(self._rules(), self.get('velocity'), self.get('laser_power'))

    # -- topics and services

    def _hold(self, message: Header) -> None:
        stamp_ns = message.stamp.sec * 1_000_000_000 + message.stamp.nanosec
        age_ns = self.now_ns() - stamp_ns
        # a stamp of 0 is that of a tool that sets none
        if stamp_ns and abs(age_ns) > _OLD_NS:
            raise ParameterError(
                f'beam_hold: is {age_ns * 1e-9:.1f} s old; do the clocks agree, is it a replay?'
            )
        if self._driver is not None:
            self._driver.hold(message.frame_id)

    def _permit(self, message: Bool) -> None:
        if self._driver is not None:
            self._driver.permit(bool(message.data))

    def _joint_trajectory(self, message: JointTrajectory) -> None:
        position, seconds = read_trajectory(message, self._joint)
        self._active().command(position, seconds)

    async def _home(self) -> Answer:
        await self.in_thread(self._active().home)
        return self._where()

    async def _stop(self) -> Answer:
        await self.in_thread(self._active().stop)
        return self._where()

    async def _clear_alarm(self) -> Answer:
        await self.in_thread(self._active().clear_alarm)
        return self._where()

    def _enabler(self, laser: str) -> Any:
        async def enable(request: Any) -> Answer:
            await self.in_thread(self._active().enable, laser, bool(request.data))
            return {'laser': laser, 'on': self._active().state().lasers[laser]}

        return enable

    def _where(self) -> Answer:
        return {'position': self._active().state().position}

    def _active(self) -> TurntableDriver:
        if self._driver is None:
            raise StateError('turntable: is not active; configure and activate it first')
        return self._driver

    def _publish(self) -> None:
        driver = self._driver
        if driver is None:
            return
        state = driver.state()
        if self.get('table') and state.alarm not in _SILENT:
            self._joint_states.publish(
                joint_state(state.stamp_ns, [self._joint], [state.position], [state.velocity])
            )
        self._publish_lasers(state)

    def _publish_lasers(self, state: BoardState) -> None:
        lasers = [float(on) for on in state.lasers.values()]
        if state.lasers_ns != self._lasers_ns:
            self._lasers_ns = self._lasers_said_ns = state.lasers_ns
            self._laser_states.publish(joint_state(state.lasers_ns, list(state.lasers), lasers))
        if state.stamp_ns - self._lasers_said_ns >= _LASER_PERIOD_NS:
            self._lasers_said_ns = state.stamp_ns
            self._laser_states.publish(joint_state(state.stamp_ns, list(state.lasers), lasers))

    def before_diagnosis(self) -> None:
        """Say what is wrong with the board."""
        driver = self._driver
        if driver is None:
            self.status(Level.OK, 'not active')
            return
        state = driver.state()
        trouble = driver.trouble or driver.refused
        level = Level.ERROR if state.alarm is not None else Level.WARN if trouble else Level.OK
        text = ': '.join(part for part in (state.alarm, trouble) if part)
        self.status(
            level,
            text or 'connected',
            position=f'{state.position:.6f}',
            reported=f'{state.reported:.6f}',
            moving=state.moving,
            lasers=', '.join(name for name, on in state.lasers.items() if on) or 'off',
        )


def _port(text: str) -> str:
    # a path would lose one of the slashes of a URL
    return text if not text or '://' in text else str(Path(text).expanduser())


def _require_names(lasers: Sequence[str]) -> None:
    wrong = [name for name in lasers if not _NAME.fullmatch(name)]
    if wrong:
        raise ParameterError(
            f'lasers: {wrong[0]!r} cannot be part of the name of a service; use letters, digits '
            'and _ (the first a letter), here and in cell.yaml'
        )
    if len(set(lasers)) != len(lasers):
        raise ParameterError(f'lasers: one is named twice ({", ".join(lasers)})')


def read_trajectory(message: JointTrajectory, joint: str) -> tuple[float, float]:
    """
    Return position (radians) and duration (seconds, 0 if it does not matter) of a command.

    :raises ParameterError: it is not one point at which the joint stands
    """
    if list(message.joint_names) != [joint]:
        raise ParameterError(
            f'joint_trajectory: is for {list(message.joint_names)}, this is {joint}'
        )
    if len(message.points) != 1:
        raise ParameterError(f'joint_trajectory: has {len(message.points)} points, not 1')
    point = message.points[0]
    if len(point.positions) != 1:
        raise ParameterError(f'joint_trajectory: has {len(point.positions)} positions, not 1')
    if any(velocity != 0.0 for velocity in point.velocities):
        raise ParameterError('joint_trajectory: the final velocity must be 0')
    start = point.time_from_start
    return float(point.positions[0]), start.sec + start.nanosec * 1e-9


def joint_state(
    stamp_ns: int,
    names: list[str],
    positions: list[float],
    velocities: list[float] | None = None,
) -> JointState:
    """Return a message of joints in radians, or of lasers in 1.0 and 0.0."""
    message = JointState(name=names, position=positions, velocity=velocities or [])
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
    return message


def main() -> int:
    """Run the node."""
    return run(TurntableNode)


if __name__ == '__main__':
    raise SystemExit(main())
