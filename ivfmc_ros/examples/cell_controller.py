# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Scans one part through the service ``start_scan``, as a cell controller does.

Needs rclpy and stock messages only, nothing of this package:

    python -m ivfmc_ros.examples.cell_controller --part bracket --profiles 60
"""

# docs: begin
import argparse
import json
import sys
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.srv import SetParameters
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy
from rclpy.qos import QoSProfile
from std_srvs.srv import Trigger

# scan_status is latched: the last message comes to a late subscriber
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
ENDED = ('DONE', 'FAILED', 'CANCELLED')


class CellController(Node):
    """Starts scans in a cell and follows them."""

    def __init__(self, namespace: str) -> None:
        super().__init__('cell_controller', namespace=namespace)
        self.status: dict[str, str] = {}
        self.create_subscription(DiagnosticStatus, 'scan_status', self._take, LATCHED)

    def _take(self, message: DiagnosticStatus) -> None:
        self.status = {item.key: item.value for item in message.values}

    def call(self, name: str, kind: type, request: Any, timeout_s: float = 30.0) -> Any:
        """Call a service and return its response."""
        client = self.create_client(kind, name)
        try:
            if not client.wait_for_service(timeout_s):
                raise TimeoutError(f'{name}: no such service within {timeout_s:g} s')
            future = client.call_async(request)
            rclpy.spin_until_future_complete(self, future, timeout_sec=timeout_s)
            if not future.done():
                raise TimeoutError(f'{name}: no response within {timeout_s:g} s')
            return future.result()
        finally:
            self.destroy_client(client)

    def scan(self, timeout_s: float = 600.0, **parameters: Any) -> Any:
        """Scan a part and return the answer: ``code`` is OK if its mesh is on disk."""
        request = SetParameters.Request()
        request.parameters = [
            Parameter(name, value=value).to_parameter_msg() for name, value in parameters.items()
        ]
        for result in self.call('orchestrator/set_parameters', SetParameters, request).results:
            if not result.successful:
                return {'code': 'BAD_PARAMETER', 'detail': result.reason}
        answer = json.loads(self.call('start_scan', Trigger, Trigger.Request()).message)
        if answer['code'] != 'OK':
            return answer
        deadline = time.monotonic() + timeout_s
        shown = None
        while time.monotonic() < deadline:
            rclpy.spin_once(self, timeout_sec=0.5)
            status = self.status
            if status.get('scan_id') != answer['scan_id']:
                continue
            now = f'{status["stage"]} {status["profiles_done"]}/{status["profiles_total"]}'
            if now != shown:
                shown = now
                self.get_logger().info(now)
            if status['stage'] in ENDED:
                return json.loads(status['result'])
        return {'code': 'TIMEOUT', 'detail': f'no end of the scan within {timeout_s:g} s'}


def main() -> int:
    """Scan one part; the exit code is 0 if the answer is OK."""
    parser = argparse.ArgumentParser(description='Scan one part in a running cell.')
    parser.add_argument('--namespace', default='/ivfmc')
    parser.add_argument('--part', default='part')
    parser.add_argument('--profiles', type=int, default=200, help='of each view')
    options = parser.parse_args()
    rclpy.init()
    node = CellController(options.namespace)
    try:
        answer = node.scan(part=options.part, profiles=options.profiles)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    print(json.dumps(answer, indent=2))
    return 0 if answer['code'] == 'OK' else 1


if __name__ == '__main__':
    sys.exit(main())
