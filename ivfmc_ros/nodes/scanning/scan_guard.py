# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What ends the waits of a scan: a cancel, a lost node, a fault of the controller, a set clock."""

from ivfmc_ros.errors import HelperError
from ivfmc_ros.nodes.scanning.cell_link import CellLink
from ivfmc_ros.nodes.scanning.cell_link import JOINTS
from ivfmc_ros.scan.disk_space import DiskWatch
from ivfmc_ros.scan.state_machine import StateMachine

NOT_RECORDED = 'NOT_RECORDED'
LASER_STUCK = 'LASER_STUCK'
# Faults of the motion controller that homing ends.
_UNLOCKED_BY_HOMING = ('CONTROLLER_ALARM', 'POSITION_LOST')


class ScanGuard:
    """
    Called at every poll of a wait; raises where the scan cannot go on.

    watched : names of the nodes, and JOINTS, without which the scan is lost
    recording : the recorder records for the scan
    needs_images : the scan still takes images, so that clocks must not jump
    needs_homing : the scan homes the table, whose controller may be locked until then
    disk : where the scan is recorded
    scan_id : of the scan, in the diagnostics of others
    """

    def __init__(
        self,
        machine: StateMachine,
        link: CellLink,
        patience_s: float,
        disk: DiskWatch,
        *,
        needs_homing: bool,
        scan_id: str,
    ) -> None:
        self._machine, self._link, self._patience_s = machine, link, patience_s
        self.disk = disk
        self._scan_id = scan_id
        self.watched: list[str] = []
        self.recording = False
        self.needs_images = True
        self.needs_homing = needs_homing

    def __call__(self) -> None:
        """:raises ScanError: the scan cannot go on."""
        self._machine.raise_if_cancelled()
        diagnostics = self._link.diagnostics
        may_be_locked = self.needs_homing and diagnostics.controller_code in _UNLOCKED_BY_HOMING
        if JOINTS in self.watched and not may_be_locked:
            # before the silence that it causes
            diagnostics.require_ready()
        stuck = diagnostics.laser_stuck(self._scan_id)
        if stuck:
            raise HelperError(LASER_STUCK, stuck)
        self._link.watch.require_alive(self.watched)
        self._link.require_unique_profiles()
        if self.needs_images:
            diagnostics.require_images()
            self._link.clocks.require_no_jump()
        if self.recording:
            # before a write fails
            self.disk.require_reserve()
        seconds = self._link.unrecorded_s
        if self.recording and seconds > self._patience_s:
            raise HelperError(
                NOT_RECORDED, f'the recorder has not written a profile for {seconds:.1f} s'
            )

    def is_lost(self, node: str) -> bool:
        """Return whether a watched node is silent; also for an empty name."""
        return not node or (node in self.watched and bool(self._link.watch.lost([node])))
