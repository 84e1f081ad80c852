# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Watches the processes of a cell that is up: a driver that dies leaves neither beam nor motion on.

When the turntable driver is killed, stopped or hangs, its controller is reset at once. The reason
for which a cell ends is published, so that its clients need not wait for a silent cell.
"""

import json
from pathlib import Path
import time
from typing import Any

import yaml

from ivfmc_ros.cli.support.cell_run import CellRun
from ivfmc_ros.cli.support.cell_run import own_parameters
from ivfmc_ros.cli.support.client import CellClient
from ivfmc_ros.cli.support.processes import Processes
from ivfmc_ros.cli.support.processes import Say
from ivfmc_ros.devices.grbl.emergency_reset import reset_controller
from ivfmc_ros.errors import ControllerLostError
from ivfmc_ros.errors import HelperError

_DRIVER = 'turntable'
_BAUD = 115200
# Seconds without a heartbeat of the driver after which it hangs.
_SILENCE_S = 1.5
# A longer time between two checks is a delay of this process and counts as this, seconds.
_LONGEST_POLL_S = 0.2


class Supervisor:
    """Checks the processes of a cell, and says why it ends."""

    def __init__(self, run: CellRun, processes: Processes, client: CellClient, say: Say) -> None:
        from diagnostic_msgs.msg import DiagnosticArray
        from diagnostic_msgs.msg import DiagnosticStatus
        from std_msgs.msg import Header

        from ivfmc_ros.nodes.framework import qos

        self._run, self._processes, self._client, self._say = run, processes, client, say
        # seconds without a heartbeat; None before the first one
        self._silent_s: float | None = None
        self._checked_s = time.monotonic()
        node = client.node
        self._status = node.create_publisher(
            DiagnosticStatus, 'scan_status', qos.of_topic('scan_status')
        )
        self._diagnostics = node.create_publisher(
            DiagnosticArray, '/diagnostics', qos.reliable(10)
        )
        node.create_subscription(Header, f'{_DRIVER}/heartbeat', self._hear, qos.reliable(10))

    def check(self) -> None:
        """
        Check all processes once.

        :raises HelperError: one has ended, or the driver of the controller does not run any more;
            the controller has been reset then
        """
        reason = self._driver_fault()
        if reason:
            self._say('up', f'{reason}; resetting the motion controller')
            raise HelperError('NODE_DIED', f'{reason}; {self._reset()}; the cell is taken down')
        ended = self._processes.ended()
        if ended is not None:
            raise HelperError('NODE_DIED', f'{ended}; the cell is taken down')

    def say_end(self, code: str, reason: str) -> None:
        """Publish why the cell ends, also as the end of a scan that runs."""
        from diagnostic_msgs.msg import DiagnosticArray

        from ivfmc_ros.nodes.framework.shutdown import flush

        node, status = self._client.node, self._client.status
        if status.get('scan_id') and not status.get('result'):
            result = {'code': code, 'detail': reason, 'scan_id': status['scan_id']}
            values = {**status, 'stage': 'FAILED', 'code': code, 'result': json.dumps(result)}
            self._status.publish(_message(node.get_namespace(), 'orchestrator', 'FAILED', values))
        text = f'ended: {reason}'
        array = DiagnosticArray(status=[_message(node.get_namespace(), 'up', text, {})])
        array.header.stamp = node.get_clock().now().to_msg()
        self._diagnostics.publish(array)
        for publisher in (self._status, self._diagnostics):
            flush(publisher)

    def reset_after_end(self) -> None:
        """Reset the controller where its driver had to be killed at the end of the cell."""
        # the controller of a simulated cell has ended with it
        if self._processes.codes.get(_DRIVER, 0) < 0 and not self._run.simulate:
            self._say('up', f'{_DRIVER} had to be killed; {self._reset()}')

    def _hear(self, _: object) -> None:
        self._silent_s = 0.0

    def _driver_fault(self) -> str:
        pid = self._processes.ids.get(_DRIVER)
        if pid is None:
            return ''
        code = self._processes.code_of(_DRIVER)
        if code is not None:
            return f'{_DRIVER} was killed by signal {-code}' if code < 0 else ''
        now = time.monotonic()
        passed, self._checked_s = min(now - self._checked_s, _LONGEST_POLL_S), now
        if _is_stopped(pid):
            return f'{_DRIVER} was stopped by a signal'
        if self._silent_s is None:
            return ''
        self._silent_s += passed
        silent = self._silent_s > _SILENCE_S
        return f'{_DRIVER} gives no heartbeat for {self._silent_s:.1f} s' if silent else ''

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
