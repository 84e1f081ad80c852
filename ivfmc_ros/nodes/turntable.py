# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Executable ``turntable``: joint trajectories and laser requests to the serial motion controller.

Publishes joint_states and laser_states as the controller reports them. A laser is on only while
``beam_hold`` is published, and for a limited time by its service (``devices.beam``).
"""

from typing import Any

from rclpy.lifecycle import LifecycleState
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from std_msgs.msg import Header
from std_srvs.srv import SetBool
from trajectory_msgs.msg import JointTrajectory

from ivfmc_ros.devices.any_controller import AnyController
from ivfmc_ros.devices.beam import BeamInterlock
from ivfmc_ros.devices.controller import ControllerState
from ivfmc_ros.devices.controller import fault_code
from ivfmc_ros.devices.controller import POSITION_LOST
from ivfmc_ros.devices.guard.beam_guard import BeamGuard
from ivfmc_ros.devices.turntable import TurntableDriver
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import StateError
from ivfmc_ros.nodes.convert.joints import joint_state
from ivfmc_ros.nodes.convert.joints import read_trajectory
from ivfmc_ros.nodes.framework.base import run
from ivfmc_ros.nodes.framework.health import Level
from ivfmc_ros.nodes.framework.health import WAITING
from ivfmc_ros.nodes.framework.json_response import Answer
from ivfmc_ros.nodes.framework.life import HEARTBEAT_S
from ivfmc_ros.nodes.framework.lifecycle import LifecycleCellNode
from ivfmc_ros.nodes.framework.timers import set_period
from ivfmc_ros.nodes.processing.turntable_parameters import declare

# Period of laser_states without a change, seconds.
_LASER_PERIOD_S = 0.1
# Seconds of standstill with all lasers off after which states are published with the heartbeat.
_IDLE_AFTER_S = 2.0
# Share of its period after which laser_states is due: the timer is early by less than the rest.
_DUE = 0.9
_CONNECTING = 'CONNECTING'
# Alarms during which the position is unknown.
_NO_POSITION = ('CONTROLLER_LOST', _CONNECTING)
# Age in nanoseconds at which a beam_hold is ignored: half a second is the time-out without any.
_MAX_HOLD_AGE_NS = 1_000_000_000
# Object of the conditions of the controller.
_CONTROLLER = 'motion controller'
_GUARD = 'beam guard'


class TurntableNode(LifecycleCellNode):
    """Connects topics and services to a TurntableDriver, which talks to the motion controller."""

    def __init__(self) -> None:
        super().__init__('turntable')
        self._driver: TurntableDriver | None = None
        # fault of a driver that has not tried to connect yet
        self._not_connected = ''
        self._published_alarm: str | None = None
        # how often the zero of the table may have become another one
        self._zeros = 0
        self._unknown_kinds: set[str] = set()
        self._controller_settings, self._beam_settings = declare(self)
        self._joint = str(self.get('joint'))
        settings = self._controller_settings()
        self._lasers, self._outputs = list(settings.lasers), list(settings.lasers.values())
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
        self._idle_s = self.steady_s() + _IDLE_AFTER_S
        self._timer = self.steady_timer(1 / self.get('joint_rate'), self._publish)

    # -- lifecycle

    def on_configure(self, state: LifecycleState) -> None:
        """Check the parameters of the controller."""
        self._controller_settings()
        if not self.get('port'):
            raise ParameterError(
                'port: is empty; set it to the serial port of the controller, such as /dev/ttyACM0'
            )

    def on_activate(self, state: LifecycleState) -> Any:
        """Connect in the background: a controller takes seconds to start."""
        self._driver = TurntableDriver(
            AnyController(self._controller_settings()),
            BeamInterlock(self._lasers, self._beam_settings()),
            velocity=self.get('velocity'),
            reconnect=self.get('reconnect'),
            guard=BeamGuard(),
        )
        self._not_connected = self._driver.fault
        self._driver.start()
        self._zeros += 1
        return super().on_activate(state)

    def release_device(self) -> None:
        """Turn the lasers off, stop the table, and disconnect."""
        driver, self._driver = self._driver, None
        if driver is not None:
            driver.close()

    # -- parameters

    def _require_same_wiring(self, values: Any) -> None:
        wiring = ([name for name in values[key] if name] for key in ('lasers', 'laser_outputs'))
        if list(wiring) != [self._lasers, self._outputs]:
            raise ParameterError('lasers, laser_outputs: can be set only at the start of the node')

    def _apply(self, _: set[str]) -> None:
        if self._driver is not None:
            self._driver.adjust(
                self._beam_settings(),
                self.get('velocity'),
                self.get('laser_power'),
                reconnect=self.get('reconnect'),
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
            self._wake()
            self._driver.hold(message.frame_id)

    def _receive_permit(self, message: Bool) -> None:
        if self._driver is not None:
            self._driver.permit(bool(message.data))

    def _receive_trajectory(self, message: JointTrajectory) -> None:
        position, seconds = read_trajectory(message, self._joint)
        self._active().command(position, seconds)

    async def _home(self) -> Answer:
        self._change_zero()
        await self.in_thread(self._active().home)
        return self._position()

    async def _stop(self) -> Answer:
        await self.in_thread(self._active().stop)
        return self._position()

    async def _clear_alarm(self) -> Answer:
        self._change_zero()
        await self.in_thread(self._active().clear_alarm)
        return self._position()

    def _change_zero(self) -> None:
        """Give the zero of the table another identity: positions from before may not fit now."""
        self._zeros += 1
        self.publish_diagnostics()

    def _note_alarm(self, state: ControllerState) -> bool:
        """Return whether the alarm is another one than before; the zero may be, too, then."""
        is_new = state.alarm != self._published_alarm
        self._published_alarm = state.alarm
        self._zeros += is_new
        return is_new

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
        self._wake()
        return self._driver

    def _wake(self) -> None:
        """Publish joint_states at their full rate from now on; at standstill they are fewer."""
        self._idle_s = self.steady_s() + _IDLE_AFTER_S
        set_period(self._timer, 1 / self.get('joint_rate'))
        if self._timer.is_canceled():
            self._timer.reset()

    def on_beat(self) -> None:
        """Publish the states of a table at rest, which need no timer of their own."""
        if self._timer.is_canceled():
            self._publish()

    def _publish(self) -> None:
        driver = self._driver
        if driver is None:
            return
        state = driver.state()
        if state.moving or any(state.lasers.values()):
            self._wake()
        elif self.steady_s() > self._idle_s and 1 / self.get('joint_rate') < HEARTBEAT_S:
            self._timer.cancel()
        if self._note_alarm(state):
            # a scan has to end at once; the next diagnostics may be a second away
            self.publish_diagnostics()
        if self.get('table') and state.alarm not in _NO_POSITION:
            self._joint_states.publish(
                joint_state(state.stamp_ns, [self._joint], [state.position], [state.velocity])
            )
        self._publish_lasers(state)

    def _publish_lasers(self, state: ControllerState) -> None:
        lasers = [float(on) for on in state.lasers.values()]
        # by the steady clock: one that is set back must not end the messages
        now_s = self.steady_s()
        # a controller that has just been connected has acknowledged none: a stamp of 0
        if state.lasers_ns and state.lasers_ns != self._lasers_ns:
            self._lasers_ns, self._lasers_published_s = state.lasers_ns, now_s
            self._laser_states.publish(joint_state(state.lasers_ns, list(state.lasers), lasers))
        if now_s - self._lasers_published_s >= _DUE * _LASER_PERIOD_S:
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
        self._note_alarm(state)
        self._report(driver, state)
        self.status(
            'connected' if state.alarm is None else '',
            code=fault_code(state.alarm),
            alarm=state.alarm or '',
            firmware=state.firmware,
            homed=state.homed,
            # of this process: a driver that is started again knows no earlier zero
            zero=f'{self.life.id}-{self._zeros}' if self.get('table') else '',
            index_mark=state.index_mark,
            unknown_lines=self._log_unknown_lines(driver),
            position=f'{state.position:.6f}',
            reported=f'{state.reported:.6f}',
            moving=state.moving,
            lasers=', '.join(name for name, on in state.lasers.items() if on) or 'off',
        )

    def _log_unknown_lines(self, driver: TurntableDriver) -> int:
        """Log each new kind of line that was not understood; return their number."""
        counts = driver.unknown_lines()
        for kind in counts.keys() - self._unknown_kinds:
            self._unknown_kinds.add(kind)
            self.get_logger().info(
                f'{_CONTROLLER}: a line of this kind is not understood and ignored: {kind}'
            )
        return sum(counts.values())

    def _report(self, driver: TurntableDriver, state: ControllerState) -> None:
        alarm = state.alarm
        fault = driver.fault or driver.rejection
        if alarm == POSITION_LOST and state.index_mark:
            fault = f'{fault}; {state.index_mark}' if fault else state.index_mark
        if alarm == _CONNECTING or (alarm and fault == self._not_connected):
            text = f'connecting on {self.get("port")}'
            self.health.set(WAITING, _CONTROLLER, self.waiting_level(), text, 'connected')
            return
        self.health.clear(WAITING, _CONTROLLER)
        if alarm is not None:
            reason = driver.guard_action or fault
            text = f'{alarm}: {reason}' if reason else alarm
            self.health.fault(_CONTROLLER, alarm, text)
        elif fault:
            self.health.fault(_CONTROLLER, 'command failed', fault, Level.WARN)
        else:
            self.health.clear_fault(_CONTROLLER)
        if driver.guard_fault:
            self.health.fault(_GUARD, 'not running', driver.guard_fault, Level.WARN)
        elif driver.guard_action:
            self.health.fault(_GUARD, 'acted', driver.guard_action, Level.WARN)
        else:
            self.health.clear_fault(_GUARD)


def main() -> int:
    """Run the node."""
    return run(TurntableNode)


if __name__ == '__main__':
    raise SystemExit(main())
