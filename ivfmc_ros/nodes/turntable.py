# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Executable ``turntable``: joint trajectories and laser requests to the serial motion controller.

Publishes joint_states and laser_states as the controller reports them. A laser is on only while
``beam_hold`` is published, and for a limited time by its service (``devices.beam``).
"""

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

from ivfmc_ros.devices.beam import BeamInterlock
from ivfmc_ros.devices.beam import BeamSettings
from ivfmc_ros.devices.controller import ControllerState
from ivfmc_ros.devices.controller import fault_code
from ivfmc_ros.devices.grbl.controller import GrblController
from ivfmc_ros.devices.grbl.settings import GrblSettings
from ivfmc_ros.devices.grbl.settings import OUTPUTS
from ivfmc_ros.devices.turntable import TurntableDriver
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import StateError
from ivfmc_ros.nodes.framework.base import run
from ivfmc_ros.nodes.framework.health import Level
from ivfmc_ros.nodes.framework.health import WAITING
from ivfmc_ros.nodes.framework.json_response import Answer
from ivfmc_ros.nodes.framework.lifecycle import LifecycleCellNode

# Period of laser_states without a change, seconds.
_LASER_PERIOD_S = 0.1
_CONNECTING = 'CONNECTING'
# Alarms during which the position is unknown.
_NO_POSITION = ('CONTROLLER_LOST', _CONNECTING)
# Names of lasers are part of the service name <laser>/enable.
_NAME = re.compile(r'[A-Za-z][A-Za-z0-9_]*')
# Age in nanoseconds at which a beam_hold is ignored: half a second is the time-out without any.
_MAX_HOLD_AGE_NS = 1_000_000_000
# Greatest position that is commanded, radians (1000 turns): numbers beyond are no position, and a
# controller computes in single precision, which has 0.0005 rad there.
_MAX_POSITION = 6283.2
# Object of the conditions of the controller.
_CONTROLLER = 'motion controller'


class TurntableNode(LifecycleCellNode):
    """Connects topics and services to a TurntableDriver, which talks to the motion controller."""

    def __init__(self) -> None:
        super().__init__('turntable')
        self._driver: TurntableDriver | None = None
        # fault of a driver that has not tried to connect yet
        self._not_connected = ''
        self._published_alarm: str | None = None
        self._declare_controller()
        self._declare_beam()
        self._lasers = [name for name in self.get('lasers') if name]
        self._joint = str(self.get('joint'))
        self._outputs = [name for name in self.get('laser_outputs') if name]
        _require_names(self._lasers)
        self._settings()
        self._beam_settings()
        self.check(self._require_same_wiring)
        self.changed(self._apply)
        self._lasers_ns, self._lasers_published_s = 0, 0.0
        self._laser_states = self.publish_on(JointState, 'laser_states')
        self.subscribe(Header, 'beam_hold', self._receive_hold)
        self.subscribe(Bool, 'beam_permit', self._receive_permit)
        if self.get('table'):
            self._joint_states = self.publish_on(JointState, 'joint_states')
            self.subscribe(JointTrajectory, 'joint_trajectory', self._receive_trajectory)
            self.trigger('home', self._home)
        self.trigger('stop', self._stop)
        self.trigger('clear_alarm', self._clear_alarm)
        for laser in self._lasers:
            self.service(SetBool, f'{laser}/enable', self._enable_handler(laser))
        self.steady_timer(1 / self.get('joint_rate'), self._publish)

    # -- lifecycle

    def on_configure(self, state: LifecycleState) -> None:
        """Check the parameters of the controller."""
        self._settings()
        if not self.get('port'):
            raise ParameterError(
                'port: is empty; set it to the serial port of the controller, such as /dev/ttyACM0'
            )

    def on_activate(self, state: LifecycleState) -> Any:
        """Connect in the background: a controller takes seconds to start."""
        self._driver = TurntableDriver(
            GrblController(self._settings()),
            BeamInterlock(self._lasers, self._beam_settings()),
            velocity=self.get('velocity'),
        )
        self._not_connected = self._driver.fault
        self._driver.start()
        return super().on_activate(state)

    def release_device(self) -> None:
        """Turn the lasers off, stop the table, and disconnect."""
        driver, self._driver = self._driver, None
        if driver is not None:
            driver.close()

    # -- parameters

    def _declare_controller(self) -> None:
        fixed: dict[str, Any] = {'read_only': True}
        declare = self.parameter
        declare('port', '', 'Serial port of the controller, or a pyserial URL.', **fixed)
        declare('baud', 115200, 'Baud rate of the serial port.', low=1200, high=4_000_000, **fixed)
        declare('axis', 'X', 'Axis letter of the table.', choices='XYZABC', **fixed)
        declare(
            'units_per_turn',
            360.0,
            'Controller units per turn; negative if positive is clockwise seen from above.',
            low=-1e6,
            high=1e6,
            **fixed,
        )
        declare('table', True, 'The controller has a table; false: lasers only.', **fixed)
        declare(
            'joint', 'turntable_joint', 'Joint name in joint_states and joint_trajectory.', **fixed
        )
        declare('joint_rate', 60.0, 'Rate of joint_states, Hz.', low=1.0, high=500.0, **fixed)
        declare('velocity', 2.0, 'Maximum velocity of the table, rad/s.', low=0.001, high=100.0)

    def _declare_beam(self) -> None:
        fixed: dict[str, Any] = {'read_only': True}
        declare = self.parameter
        declare('lasers', ['left', 'right'], 'Names of the lasers, as in cell.yaml.')
        declare(
            'laser_outputs',
            ['spindle', 'coolant'],
            'Output of each laser: spindle (M3, M5) or coolant (M8, M9).',
        )
        declare(
            'laser_power',
            1.0,
            'Power of a laser on the spindle output, 0 to 1.',
            low=0.0,
            high=1.0,
        )
        declare(
            'beam_hold_timeout',
            0.5,
            'Seconds without beam_hold until the lasers go off.',
            low=0.1,
            high=5.0,
        )
        declare(
            'beam_limit',
            10.0,
            'Seconds that a laser stays on by its service.',
            low=0.0,
            high=600.0,
        )
        declare(
            'beam_permit_required', False, 'Lasers stay off until beam_permit is true.', **fixed
        )
        declare(
            'beam_permit_timeout',
            0.0,
            'Seconds that a beam_permit stays valid; 0: until it is false.',
            low=0.0,
            high=600.0,
        )

    def _settings(self) -> GrblSettings:
        if len(self._outputs) != len(self._lasers):
            raise ParameterError(
                f'laser_outputs: {len(self._outputs)} for {len(self._lasers)} lasers; '
                f'each laser needs one of {", ".join(OUTPUTS)}'
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
            raise ParameterError('lasers, laser_outputs: can be set only at the start of the node')

    def _beam_settings(self) -> BeamSettings:
        return BeamSettings(
            hold_timeout=self.get('beam_hold_timeout'),
            limit=self.get('beam_limit'),
            permit_required=self.get('beam_permit_required'),
            permit_timeout=self.get('beam_permit_timeout'),
        )

    def _apply(self, _: set[str]) -> None:
        if self._driver is not None:
            self._driver.adjust(
                self._beam_settings(), self.get('velocity'), self.get('laser_power')
            )

    # -- topics and services

    def _receive_hold(self, message: Header) -> None:
        stamp_ns = message.stamp.sec * 1_000_000_000 + message.stamp.nanosec
        age_ns = self.now_ns() - stamp_ns
        # a stamp of 0 comes from a tool that sets none
        if stamp_ns and abs(age_ns) > _MAX_HOLD_AGE_NS:
            raise ParameterError(
                f'beam_hold: ignored: its stamp is {age_ns * 1e-9:.1f} s old; synchronize the '
                'clocks, and do not replay this topic'
            )
        if self._driver is not None:
            self._driver.hold(message.frame_id)

    def _receive_permit(self, message: Bool) -> None:
        if self._driver is not None:
            self._driver.permit(bool(message.data))

    def _receive_trajectory(self, message: JointTrajectory) -> None:
        position, seconds = read_trajectory(message, self._joint)
        self._active().command(position, seconds)

    async def _home(self) -> Answer:
        await self.in_thread(self._active().home)
        return self._position()

    async def _stop(self) -> Answer:
        await self.in_thread(self._active().stop)
        return self._position()

    async def _clear_alarm(self) -> Answer:
        await self.in_thread(self._active().clear_alarm)
        return self._position()

    def _enable_handler(self, laser: str) -> Any:
        async def enable(request: Any) -> Answer:
            await self.in_thread(self._active().enable, laser, bool(request.data))
            return {'laser': laser, 'on': self._active().state().lasers[laser]}

        return enable

    def _position(self) -> Answer:
        return {'position': self._active().state().position}

    def _active(self) -> TurntableDriver:
        if self._driver is None:
            raise StateError('turntable: the node is not active; configure and activate it first')
        return self._driver

    def _publish(self) -> None:
        driver = self._driver
        if driver is None:
            return
        state = driver.state()
        if state.alarm != self._published_alarm:
            # a scan has to end at once; the next diagnostics may be a second away
            self._publish_diagnostics()
        if self.get('table') and state.alarm not in _NO_POSITION:
            self._joint_states.publish(
                joint_state(state.stamp_ns, [self._joint], [state.position], [state.velocity])
            )
        self._publish_lasers(state)

    def _publish_lasers(self, state: ControllerState) -> None:
        lasers = [float(on) for on in state.lasers.values()]
        # by the steady clock: one that is set back must not end the messages
        now_s = self.steady_s()
        if state.lasers_ns != self._lasers_ns:
            self._lasers_ns, self._lasers_published_s = state.lasers_ns, now_s
            self._laser_states.publish(joint_state(state.lasers_ns, list(state.lasers), lasers))
        if now_s - self._lasers_published_s >= _LASER_PERIOD_S:
            self._lasers_published_s = now_s
            self._laser_states.publish(joint_state(state.stamp_ns, list(state.lasers), lasers))

    def before_diagnosis(self) -> None:
        """Publish the state of the controller and its alarm or fault."""
        driver = self._driver
        if driver is None:
            self.health.clear(WAITING, _CONTROLLER)
            self.health.clear_fault(_CONTROLLER)
            self.status('not active')
            return
        state = driver.state()
        self._published_alarm = state.alarm
        self._report(driver, state.alarm)
        self.status(
            'connected' if state.alarm is None else '',
            code=fault_code(state.alarm),
            alarm=state.alarm or '',
            position=f'{state.position:.6f}',
            reported=f'{state.reported:.6f}',
            moving=state.moving,
            lasers=', '.join(name for name, on in state.lasers.items() if on) or 'off',
        )

    def _report(self, driver: TurntableDriver, alarm: str | None) -> None:
        fault = driver.fault or driver.rejection
        if alarm == _CONNECTING or (alarm and fault == self._not_connected):
            text = f'connecting on {self.get("port")}'
            self.health.set(WAITING, _CONTROLLER, self.waiting_level(), text, 'connected')
            return
        self.health.clear(WAITING, _CONTROLLER)
        if alarm is not None:
            text = f'{alarm}: {fault}' if fault else alarm
            self.health.fault(_CONTROLLER, alarm, text)
        elif fault:
            self.health.fault(_CONTROLLER, 'command failed', fault, Level.WARN)
        else:
            self.health.clear_fault(_CONTROLLER)


def _port(text: str) -> str:
    # Path would drop one of the slashes of a URL
    return text if not text or '://' in text else str(Path(text).expanduser())


def _require_names(lasers: Sequence[str]) -> None:
    wrong = [name for name in lasers if not _NAME.fullmatch(name)]
    if wrong:
        raise ParameterError(
            f'lasers: {wrong[0]!r} cannot be part of a service name; use letters, digits and _ '
            '(the first a letter), here and in cell.yaml'
        )
    if len(set(lasers)) != len(lasers):
        raise ParameterError(f'lasers: a name occurs twice ({", ".join(lasers)})')


def read_trajectory(message: JointTrajectory, joint: str) -> tuple[float, float]:
    """
    Return position (radians) and duration (seconds, 0: as fast as allowed) of a command.

    :raises ParameterError: it is for another joint, or not a single point with velocity 0
    """
    if list(message.joint_names) != [joint]:
        raise ParameterError(
            f'joint_trajectory: is for joints {list(message.joint_names)}, not for {joint}'
        )
    if len(message.points) != 1:
        raise ParameterError(f'joint_trajectory: has {len(message.points)} points, not 1')
    point = message.points[0]
    if len(point.positions) != 1:
        raise ParameterError(f'joint_trajectory: has {len(point.positions)} positions, not 1')
    if any(velocity != 0.0 for velocity in point.velocities):
        raise ParameterError('joint_trajectory: the final velocity must be 0')
    position, start = float(point.positions[0]), point.time_from_start
    # written so that NaN is refused, too
    if not abs(position) <= _MAX_POSITION:
        raise ParameterError(
            f'joint_trajectory: the position {position} rad is not finite, or beyond '
            f'{_MAX_POSITION:g} rad'
        )
    seconds = start.sec + start.nanosec * 1e-9
    if seconds < 0.0:
        raise ParameterError(f'joint_trajectory: time_from_start is negative, {seconds} s')
    return position, seconds


def joint_state(
    stamp_ns: int,
    names: list[str],
    positions: list[float],
    velocities: list[float] | None = None,
) -> JointState:
    """Return a JointState of joints (radians, rad/s) or of lasers (1.0 on, 0.0 off)."""
    message = JointState(name=names, position=positions, velocity=velocities or [])
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
    return message


def main() -> int:
    """Run the node."""
    return run(TurntableNode)


if __name__ == '__main__':
    raise SystemExit(main())
