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
        # how the working volume cuts the part, by the id of the scan
        self._cuts: dict[str, str] = {}
        # the laser that shines although it is off, by the id of the scan
        self._stuck: dict[str, str] = {}
        self._dark_ns: dict[str, int] = {}
        self._unsettled: dict[str, str] = {}
        self._rates: dict[str, StripeRate | None] = {}
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
        return self._cuts.get(scan_id, '')

    def laser_stuck(self, scan_id: str) -> str:
        """Return which laser of a scan shines although it is reported off; '' if none does."""
        return self._stuck.get(scan_id, '')

    def dark_ns(self, scan_id: str) -> int:
        """Return the stamp of the last image of a scan in which no laser shines; 0: none yet."""
        return self._dark_ns.get(scan_id, 0)

    def unsettled(self, scan_id: str) -> str:
        """Return how the stripe of a scan moved after stops of the table; '' if it did not."""
        return self._unsettled.get(scan_id, '')

    def stripe_rate(self, scan_id: str) -> StripeRate | None:
        """Return how fast the stripe of a laser that is not measured moves; None: unknown."""
        return self._rates.get(scan_id)

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
                # of the last scan only
                self._table_fault = values.get('table_fault', '')
                scan_id = values.get('scan_id', '')
                self._cuts = {scan_id: values.get('part_cut', '')}
                self._stuck = {scan_id: values.get('laser_stuck', '')}
                dark_ns = values.get('dark_since_stamp', '')
                self._dark_ns = {scan_id: int(dark_ns) if dark_ns.isdigit() else 0}
                self._unsettled = {scan_id: values.get('unsettled', '')}
                self._rates = {scan_id: _rate(values)}


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
