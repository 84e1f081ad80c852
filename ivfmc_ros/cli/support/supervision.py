# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Watches the processes of a cell that is up: a driver that dies leaves neither beam nor motion on.

When the turntable driver is killed, stopped or hangs, its controller is reset at once. A node that
has ended or hangs is started again, or the cell ends. The reason for which a cell ends is
published, so that its clients need not wait for a silent cell.
"""

import json
from pathlib import Path
import time
from typing import Any

import yaml

from ivfmc_ros.cli.support.cell_run import CellRun
from ivfmc_ros.cli.support.cell_run import own_parameters
from ivfmc_ros.cli.support.cell_run import SIMULATION
from ivfmc_ros.cli.support.cell_run import WINDOW
from ivfmc_ros.cli.support.client import CellClient
from ivfmc_ros.cli.support.processes import Processes
from ivfmc_ros.cli.support.processes import Say
from ivfmc_ros.cli.support.restarts import MOST
from ivfmc_ros.cli.support.restarts import Restarts
from ivfmc_ros.devices.guard.emergency_reset import reset_controller
from ivfmc_ros.errors import ControllerLostError
from ivfmc_ros.errors import HelperError

_DRIVER, _ORCHESTRATOR = 'turntable', 'orchestrator'
# In which what was published during a reset is received, seconds.
_NEWS_S = 0.2
_BAUD = 115200
# Seconds without a heartbeat of the driver after which it hangs.
_SILENCE_S = 1.5
# ... of another node, which then is killed and started again. Other programs may starve it.
_NODE_SILENCE_S = 20.0
# Exit code of a node that cannot be created, such as with a wrong parameter: it would not be
# created the next time either.
_NOT_CREATED = 2
# A longer time between two checks is a delay of this process and counts as this, seconds.
_LONGEST_POLL_S = 0.2
# Seconds between two checks.
_CHECK_S = 0.1


class Supervisor:
    """Checks the processes of a cell, and says why it ends."""

    def __init__(
        self,
        run: CellRun,
        processes: Processes,
        client: CellClient,
        say: Say,
        *,
        restart: bool = True,
    ) -> None:
        """
        Start with a cell that has just been started.

        restart : start a node that has ended again; otherwise the cell ends, but for the window,
            which the cell can do without
        """
        from diagnostic_msgs.msg import DiagnosticArray

        from ivfmc_ros.nodes.framework import qos
        from ivfmc_ros.nodes.framework.heartbeats import Heartbeats

        self._run, self._processes, self._client, self._say = run, processes, client, say
        self._restarts = Restarts() if restart else None
        # what has ended for good, and the cell goes on without
        self._given_up: set[str] = set()
        # seconds without a heartbeat by node, since its first one
        self._silent_s: dict[str, float] = {}
        self._checked_s = time.monotonic()
        node = client.node
        self._status = _status_publisher(node)
        self._diagnostics = node.create_publisher(
            DiagnosticArray, '/diagnostics', qos.reliable(10)
        )
        self._heartbeats = Heartbeats(node, run.nodes, self._hear)

    def check(self) -> None:
        """
        Check all processes once, and start those again that are due.

        :raises HelperError: one has ended, or hangs, and is not started again; the controller has
            been reset if it was its driver
        """
        if time.monotonic() - self._checked_s < _CHECK_S:
            return
        self._heartbeats.fetch()
        self._count_silence()
        away = self._given_up | (self._restarts.pending if self._restarts else set())
        for name in [name for name in self._processes.ids if name not in away]:
            reason = self._driver_fault() if name == _DRIVER else self._node_fault(name)
            if reason and name == _DRIVER:
                self._end_driver(reason)
            elif reason:
                self._processes.kill(name)
                self._end(name, reason)
        pending = self._restarts.pending if self._restarts else set()
        ended = self._processes.ended(pending | self._given_up)
        if ended is not None and ended.name == _DRIVER and ended.code < 0:
            # killed since it was looked at above
            self._end_driver(str(ended))
        elif ended is not None:
            self._end(ended.name, str(ended), is_final=ended.code == _NOT_CREATED)
        for name in self._restarts.due() if self._restarts else ():
            self._silent_s.pop(name, None)
            if name == _ORCHESTRATOR:
                self._withdraw_status()
            self._processes.restart(name)
            self._say('up', f'{name} is started again')

    def _end_driver(self, reason: str) -> None:
        """Reset the controller of a driver that is lost; then as ``_end``."""
        self._say('up', f'{reason}; resetting the motion controller')
        self._end(_DRIVER, f'{reason}; {self._reset()}')

    def _end(self, name: str, reason: str, *, is_final: bool = False) -> None:
        """Let a process that has ended be started again; :raises HelperError: it is not."""
        try:
            if self._restarts is None or is_final or name == SIMULATION:
                raise HelperError('NODE_DIED', reason)
            delay_s, number = self._restarts.add(name)
        except HelperError as error:
            text = reason if reason in str(error) else f'{reason}; {error}'
            if name == WINDOW:
                self._given_up.add(name)
                self._say('up', f'{text}; the cell goes on without its window')
                return
            raise HelperError(error.code, f'{text}; the cell is taken down') from error
        text = f'{reason}; it is started again in {delay_s:.1f} s ({number} of at most {MOST})'
        self._say('up', text)
        # the orchestrator need not wait for the silence of the node
        self._publish_diagnostics(text, ended=name)
        if name == _ORCHESTRATOR:
            # its clients need not wait until it is back and says so itself
            self._fail_scan('INTERRUPTED', text)

    def say_end(self, code: str, reason: str) -> None:
        """Publish why the cell ends, also as the end of a scan that runs."""
        from ivfmc_ros.nodes.framework.shutdown import flush

        # a scan may have begun while the controller was reset
        deadline = time.monotonic() + _NEWS_S
        while (left_s := deadline - time.monotonic()) > 0.0:
            self._client.spin(left_s)
        self._fail_scan(code, reason)
        self._publish_diagnostics(f'ended: {reason}')
        for publisher in (self._status, self._diagnostics):
            flush(publisher)

    def reset_after_end(self) -> None:
        """Reset the controller where its driver had to be killed at the end of the cell."""
        # the controller of a simulated cell has ended with it
        if self._processes.codes.get(_DRIVER, 0) < 0 and not self._run.simulate:
            self._say('up', f'{_DRIVER} had to be killed; {self._reset()}')

    def _fail_scan(self, code: str, reason: str) -> None:
        """Publish the end of a scan that runs, in the name of the orchestrator."""
        node, status = self._client.node, self._client.status
        if status.get('scan_id') and not status.get('result'):
            result = {'code': code, 'detail': reason, 'scan_id': status['scan_id']}
            values = {**status, 'stage': 'FAILED', 'code': code, 'result': json.dumps(result)}
            self._status.publish(_message(node.get_namespace(), _ORCHESTRATOR, 'FAILED', values))

    def _withdraw_status(self) -> None:
        """Leave no latched status beside that of the next orchestrator."""
        self._client.node.destroy_publisher(self._status)
        self._status = _status_publisher(self._client.node)

    def _publish_diagnostics(self, text: str, **values: str) -> None:
        from diagnostic_msgs.msg import DiagnosticArray

        node = self._client.node
        array = DiagnosticArray(status=[_message(node.get_namespace(), 'up', text, values)])
        array.header.stamp = node.get_clock().now().to_msg()
        self._diagnostics.publish(array)

    def _hear(self, name: str) -> None:
        self._silent_s[name] = 0.0

    def _count_silence(self) -> None:
        now = time.monotonic()
        passed, self._checked_s = min(now - self._checked_s, _LONGEST_POLL_S), now
        for name in self._silent_s:
            self._silent_s[name] += passed

    def _node_fault(self, name: str) -> str:
        """Return why a node that runs does not work, '' where it does."""
        if self._processes.code_of(name) is not None:
            return ''
        if _is_stopped(self._processes.ids[name]):
            return f'{name} was stopped by a signal'
        silent_s = self._silent_s.get(name, 0.0)
        is_silent = silent_s > _NODE_SILENCE_S
        return f'{name} gives no heartbeat for {silent_s:.1f} s' if is_silent else ''

    def _driver_fault(self) -> str:
        pid = self._processes.ids.get(_DRIVER)
        if pid is None:
            return ''
        code = self._processes.code_of(_DRIVER)
        if code is not None:
            return f'{_DRIVER} was killed by signal {-code}' if code < 0 else ''
        if _is_stopped(pid):
            return f'{_DRIVER} was stopped by a signal'
        silent_s = self._silent_s.get(_DRIVER, 0.0)
        is_silent = silent_s > _SILENCE_S
        return f'{_DRIVER} gives no heartbeat for {silent_s:.1f} s' if is_silent else ''

    def _reset(self) -> str:
        """Kill the driver, which holds the port, and reset the controller; say what happened."""
        self._processes.kill(_DRIVER)
        parameters = _driver_parameters(self._run)
        port = str(parameters.get('port', ''))
        if not port:
            return 'it had no controller'
        try:
            reset_controller(port, int(parameters.get('baud', _BAUD)))
        except ControllerLostError as error:
            return f'the motion controller could NOT be reset, turn it off: {error}'
        return 'the motion controller was reset: lasers off, table stopped'


def _is_stopped(pid: int) -> bool:
    try:
        state = Path(f'/proc/{pid}/stat').read_text(encoding='utf-8').rpartition(')')[2].split()[0]
    except (OSError, IndexError):
        return False
    return state == 'T'


def _driver_parameters(run: CellRun) -> dict[str, Any]:
    """Return the parameters with which the driver was started: file, own, and overrides."""
    found: dict[str, Any] = {}
    try:
        document = yaml.safe_load((run.config / f'{_DRIVER}.yaml').read_text(encoding='utf-8'))
        for values in document.values():
            found.update(values.get('ros__parameters', {}))
    except (OSError, ValueError, yaml.YAMLError, AttributeError):
        # such as no file: the command line has all of it
        found = {}
    return {**found, **own_parameters(run, _DRIVER), **run.overrides.get(_DRIVER, {})}


def _status_publisher(node: Any) -> Any:
    from diagnostic_msgs.msg import DiagnosticStatus

    from ivfmc_ros.nodes.framework import qos

    return node.create_publisher(DiagnosticStatus, 'scan_status', qos.of_topic('scan_status'))


def _message(namespace: str, name: str, text: str, values: dict[str, str]) -> Any:
    from diagnostic_msgs.msg import DiagnosticStatus
    from diagnostic_msgs.msg import KeyValue

    return DiagnosticStatus(
        level=DiagnosticStatus.ERROR,
        name=f'{namespace}/{name}'.strip('/').replace('//', '/'),
        message=text,
        hardware_id=namespace.strip('/'),
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )
