# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the diagnostics say: faults of controller, camera, lasers, a part that is cut, an end."""

from collections.abc import Callable
from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticArray
from diagnostic_msgs.msg import DiagnosticStatus

from ivfmc_ros.errors import HelperError
from ivfmc_ros.nodes.framework import qos
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.stripe.stripe_motion import StripeRate


class DiagnosticsWatch:
    """
    Reads the diagnostics of our nodes and of ``ivfmc up`` in a namespace.

    controller_code : CONTROLLER_ALARM, CONTROLLER_LOST or POSITION_LOST; '' without a fault, or
        where another driver moves the table
    zero : identity of the table's zero; None before the diagnostics of turntable are received
    controller_message : of the turntable's diagnostics when they were not OK, '' otherwise
    """

    def __init__(
        self, node: CellNode, on_end: Callable[[str, str], object] = lambda name, reason: None
    ) -> None:
        """``on_end`` : called with the name of a node that ``up`` saw end, and what it says."""
        self._on_end = on_end
        self._up = f'{node.get_namespace()}/up'.lstrip('/')
        self.controller_code, self.controller_message = '', ''
        self.zero: str | None = None
        # what the triangulator says of its last scan
        self._said: Mapping[str, str] = {}
        self._table_fault = self._camera_fault = ''
        self._camera = f'{node.get_namespace()}/camera'.lstrip('/')
        self._turntable = f'{node.get_namespace()}/turntable'.lstrip('/')
        self._triangulator = f'{node.get_namespace()}/triangulator'.lstrip('/')
        self._subscription = node.create_subscription(
            DiagnosticArray,
            '/diagnostics',
            node.guarded(self._receive, 'diagnostics'),
            qos.reliable(50),
            event_callbacks=qos.NO_SUBSCRIPTION_EVENTS,
        )

    def require_ready(self) -> None:
        """:raises HelperError: the controller has a fault, or the joint has two publishers."""
        if self.controller_code:
            raise HelperError(self.controller_code, f'turntable: {self.controller_message}')
        if self._table_fault:
            raise HelperError('JOINT_CONTRADICTORY', self._table_fault)

    def require_images(self) -> None:
        """:raises HelperError: our camera is lost, frozen, or gives images of another size."""
        if self._camera_fault:
            raise HelperError('CAMERA_LOST', f'camera: {self._camera_fault}')

    def part_cut(self, scan_id: str) -> str:
        """Return how the working volume cuts the part of a scan; '' if it does not."""
        return self._of_scan(scan_id).get('part_cut', '')

    def laser_stuck(self, scan_id: str) -> str:
        """Return which laser of a scan shines although it is reported off; '' if none does."""
        return self._of_scan(scan_id).get('laser_stuck', '')

    def dark_ns(self, scan_id: str) -> int:
        """Return the stamp of the last image of a scan in which no laser shines; 0: none yet."""
        dark_ns = self._of_scan(scan_id).get('dark_since_stamp', '')
        return int(dark_ns) if dark_ns.isdigit() else 0

    def unsettled(self, scan_id: str) -> str:
        """Return how the stripe of a scan moved after stops of the table; '' if it did not."""
        return self._of_scan(scan_id).get('unsettled', '')

    def focus(self, scan_id: str) -> str:
        """Return how the light sheets of a scan differ from those calibrated; '' if not."""
        return self._of_scan(scan_id).get('focus', '')

    def stripe_rate(self, scan_id: str) -> StripeRate | None:
        """Return how fast the stripe of a laser that is not measured moves; None: unknown."""
        return _rate(self._of_scan(scan_id))

    def _of_scan(self, scan_id: str) -> Mapping[str, str]:
        return self._said if self._said.get('scan_id', '') == scan_id else {}

    def _receive(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == self._turntable:
                values = {value.key: value.value for value in status.values}
                self.controller_code = values.get('code', '')
                self.zero = values.get('zero', '')
                is_ok = status.level == DiagnosticStatus.OK
                is_fine = is_ok and not self.controller_code
                self.controller_message = '' if is_fine else status.message
            if status.name == self._camera:
                values = {value.key: value.value for value in status.values}
                self._camera_fault = values.get('fault', '')
            if status.name == self._up:
                values = {value.key: value.value for value in status.values}
                if values.get('ended'):
                    self._on_end(values['ended'], status.message)
            if status.name == self._triangulator:
                values = {value.key: value.value for value in status.values}
                self._said = values
                self._table_fault = values.get('table_fault', '')


def _rate(values: Mapping[str, str]) -> StripeRate | None:
    """Return the rate of the stripe in the diagnostics of a triangulator; None without one."""
    try:
        return StripeRate(
            laser=int(values['stripe_laser']),
            seconds=float(values['stripe_seconds']),
            rate=float(values['stripe_rate']),
            u=float(values['stripe_rate_u']),
        )
    except (KeyError, ValueError):
        return None
