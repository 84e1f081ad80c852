# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Executable ``orchestrator``: one service call scans a part.

Runs one scan at a time: moves the table, switches the lasers, and calls the services of the other
nodes. Services scan, start_scan, cancel, pause, resume; progress on ``scan_status``.
"""

from pathlib import Path
import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_msgs.msg import KeyValue
from rclpy.task import Future

from ivfmc_ros.cell.cell_file import CellDraft
from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.errors import BusyError
from ivfmc_ros.errors import CellError
from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.errors import StateError
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.base import run
from ivfmc_ros.nodes.framework.futures import ServiceClients
from ivfmc_ros.nodes.framework.futures import Waiter
from ivfmc_ros.nodes.framework.health import Level
from ivfmc_ros.nodes.framework.json_response import Answer
from ivfmc_ros.nodes.framework.shutdown import flush
from ivfmc_ros.nodes.scanning.cell_link import CellLink
from ivfmc_ros.nodes.scanning.graph_tools import GraphTools
from ivfmc_ros.nodes.scanning.report_queue import ReportQueue
from ivfmc_ros.nodes.scanning.resumption import Resumption
from ivfmc_ros.nodes.scanning.running_scan import interrupted_status
from ivfmc_ros.nodes.scanning.running_scan import RunningScan
from ivfmc_ros.nodes.scanning.scan_context import ScanContext
from ivfmc_ros.nodes.scanning.scan_parameters import declare_scan_parameters
from ivfmc_ros.scan import scan_folder
from ivfmc_ros.scan.disk_space import DiskWatch
from ivfmc_ros.scan.disk_space import SpaceEstimate
from ivfmc_ros.scan.plan import make_plan
from ivfmc_ros.scan.plan import require_steps
from ivfmc_ros.scan.report import PENDING
from ivfmc_ros.scan.report import pending_reports
from ivfmc_ros.scan.resume import InterruptedScan
from ivfmc_ros.scan.state_machine import StateMachine
from ivfmc_ros.storage.catalogue.catalogue import Catalogue

# Period of ``scan_status`` during a scan, seconds.
_STATUS_S = 0.5


class Orchestrator(CellNode):
    """Accepts a scan with the current parameters and runs it to its response."""

    def __init__(self) -> None:
        super().__init__('orchestrator')
        self.scan_parameters = declare_scan_parameters(self)
        self._service_clients = ServiceClients(self, Waiter(self))
        self._running: RunningScan | None = None
        self._last: RunningScan | None = None
        # status before the first scan: that of one that the former process left running
        self._first_status = RunningScan.idle_status()
        joint = self.parameter(
            'joint', 'turntable_joint', 'Joint name of the table in joint_states.', read_only=True
        )
        self._link = CellLink(self, joint, self.get('heartbeat_limit'))
        self._space = SpaceEstimate()
        self._resumption = Resumption(self, self._link, self._service_clients)
        self._status = self.publish_on(DiagnosticStatus, 'scan_status')
        self._reports = ReportQueue(self, self._report_ended)
        for name, handler in (
            ('start_scan', self._start_scan),
            ('scan', self._scan),
            ('cancel', self._cancel),
            ('pause', self._pause),
            ('resume', self._resume),
        ):
            self.trigger(name, handler, private=False)
        self.steady_timer(_STATUS_S, self._repeat_status)

    def on_settled(self) -> None:
        """Mark interrupted scans, publish the first status, and render reports that are due."""
        self._mark_interrupted_scans()
        self._publish_status()
        for folder in pending_reports(Path(self.get('scan_root'))):
            self._reports.add(folder)

    def stop(self) -> None:
        """Turn the lasers off, stop the table, and mark the scan as interrupted."""
        self._reports.close()
        running = self._running
        if running is not None:
            self._link.close()
            reason = f'the orchestrator ended while the scan was {running.machine.stage}'
            running.result = {
                'code': 'INTERRUPTED',
                'detail': f'{reason}: {self.ending}',
                'scan_id': running.scan_id,
                'folder': str(running.folder),
            }
            self._publish_status()
            flush(self._status)
            running.mark_interrupted()
        super().stop()

    def _mark_interrupted_scans(self) -> None:
        root = Path(self.get('scan_root'))
        if not root.is_dir():
            return
        marked, errors = scan_folder.mark_interrupted_scans(root)
        for scan_id in marked:
            self.get_logger().warning(f'scan {scan_id} was interrupted and is marked FAILED')
            try:
                Catalogue(root).set_stage(scan_id, 'FAILED', 'INTERRUPTED')
            except ScanError as error:
                # such as a scan without a row; the next ones have to be marked as well
                errors.append(str(error))
        if marked:
            # its clients wait for the end
            try:
                self._first_status = interrupted_status(root / marked[-1])
            except ScanError as error:
                errors.append(str(error))
        for text in errors:
            self.get_logger().warning(text)

    def _start_scan(self) -> Answer:
        running = self._accept_scan()
        return {'scan_id': running.scan_id, 'folder': str(running.folder)}

    async def _scan(self) -> Answer:
        result: Answer = await self._accept_scan().ended
        if result['code'] != 'OK':
            more = {key: value for key, value in result.items() if key not in ('code', 'detail')}
            raise HelperError(str(result['code']), str(result.get('detail', '')), **more)
        return result

    def _cancel(self) -> Answer:
        return self._request(StateMachine.cancel)

    def _pause(self) -> Answer:
        return self._request(StateMachine.pause)

    async def _resume(self) -> Answer:
        if self._running is not None:
            return self._request(StateMachine.resume)
        interrupted, homes = await self._resumption.load()
        running = self._begin(self._resumed_context(interrupted, home=homes))
        return {
            'scan_id': running.scan_id,
            'stage': str(running.machine.stage),
            'resumed': True,
            'profiles': interrupted.first_profile,
        }

    def _request(self, request: Any) -> Answer:
        running = self._running
        if running is None:
            raise StateError('no scan is running')
        request(running.machine)
        return {'scan_id': running.scan_id, 'stage': str(running.machine.stage)}

    def _accept_scan(self) -> RunningScan:
        """Start a scan with the current parameters."""
        if self._running is not None:
            scan_id = self._running.scan_id
            raise BusyError(f'scan {scan_id} is {self._running.machine.stage}', scan_id=scan_id)
        self._resumption.require_idle()
        recipe = self.scan_parameters.recipe()
        request = self.scan_parameters.request(recipe)
        motion = self.scan_parameters.motion(recipe)
        cell = Path(self.get('cell'))
        if not self.get('cell'):
            raise CellError('orchestrator: cell: is empty; set it to the path of cell.yaml')
        draft = load_draft(cell)
        if draft.turntable is not None and draft.turntable.joint != self._link.joint:
            raise CellError(
                f'{cell}: turntable.joint: is {draft.turntable.joint}, the parameter joint of the '
                f'orchestrator {self._link.joint}; start it with the name in joint_states'
            )
        names = [laser.name for laser in draft.lasers]
        # homing makes its position 0
        position = 0.0 if self.get('home') else self._link.position or 0.0
        trigger_step = draft.turntable.trigger_step if draft.turntable is not None else 0.0
        plan = make_plan(request, names, motion, position, trigger_step)
        require_steps(plan, self.get('position_tolerance'), 'position_tolerance')
        root = Path(self.get('scan_root')).absolute()
        if root.is_dir():
            DiskWatch(root, self._reserve).require_room(self._space.of(plan.profiles))
        folder = scan_folder.create_scan_folder(root, request.part)
        context = ScanContext(
            scan_id=folder.name,
            folder=folder,
            request=request,
            plan=plan,
            motion=motion,
            cell=cell,
            cell_name=self.get_namespace().strip('/'),
            tolerance=self.get('position_tolerance'),
            patience=self.get('profile_patience'),
            home=self.get('home'),
            reserve=self._reserve,
            limits=self.scan_parameters.limits(recipe),
            recipe=recipe,
        )
        return self._begin(context, draft)

    @property
    def _reserve(self) -> float:
        """Bytes of the disk that stay free."""
        return float(self.get('min_free_space')) * 1e6

    def _resumed_context(self, interrupted: InterruptedScan, *, home: bool) -> ScanContext:
        """Return what an interrupted scan goes on with: its own request, plan and limits."""
        course, request, folder = interrupted.course, interrupted.request, interrupted.folder
        left = max(0, course.plan.profiles - interrupted.first_profile)
        DiskWatch(folder.parent, self._reserve).require_room(self._space.of(left))
        return ScanContext(
            scan_id=folder.name,
            folder=folder,
            request=request,
            plan=course.plan,
            motion=course.motion,
            cell=Path(self.get('cell')),
            cell_name=self.get_namespace().strip('/'),
            tolerance=course.tolerance,
            patience=course.patience,
            home=home,
            reserve=self._reserve,
            limits=course.limits,
            recipe=interrupted.recipe,
            resumed=interrupted,
        )

    def _begin(self, context: ScanContext, draft: CellDraft | None = None) -> RunningScan:
        """Run a scan; ``draft``: the calibration of a new one."""
        machine = StateMachine(lambda _: self._on_stage_change())
        tools = GraphTools(self, self._link, self._service_clients, context, machine)
        running = RunningScan(
            context=context,
            machine=machine,
            tools=tools,
            link=self._link,
            ended=Future(executor=self.executor),
        )
        if draft is None:
            running.reopen()
        else:
            running.save_inputs(draft, self._snapshot())
        self._running = running
        self._publish_status()
        self.executor.create_task(self._run_scan, running)
        how = 'started' if draft else 'resumed'
        self.get_logger().info(f'scan {running.scan_id} {how}')
        return running

    async def _run_scan(self, running: RunningScan) -> None:
        """Run a scan to its end; raises nothing, which would end the executor."""
        try:
            result = await running.run()
        except Exception as error:  # such as a report that cannot be written
            self.fault('scan', error)
            code = error.code if isinstance(error, ScanError) else 'INTERNAL'
            result = {'code': code, 'detail': str(error), 'scan_id': running.scan_id}
            self._link.hold(None)
        else:
            self.health.clear_fault('scan')
        running.result = result
        self._last, self._running = running, None
        if result['code'] == 'OK':
            # a cancelled scan says nothing of a whole one
            self._space.learn(running.folder, running.context.plan.profiles)
        self._link.end_scan()
        self._publish_status()
        self.get_logger().info(f'scan {running.scan_id} ended: {result["code"]}')
        running.ended.set_result(result)
        if result.get(PENDING):
            self._reports.add(running.folder)

    def _report_ended(self, folder: Path, error: str) -> None:
        if error:
            self.get_logger().warning(f'report of scan {folder.name}: {error}')
        for scan in (self._running, self._last):
            if scan is not None and scan.folder == folder:
                scan.report_ended(error)
                self._publish_status()

    def _snapshot(self) -> dict[str, Any]:
        return {name: self.get(name) for name in sorted(self._parameters)}

    def _on_stage_change(self) -> None:
        running = self._running
        # the final status is published together with the response
        if running is not None and running.machine.running:
            running.on_stage_change()
            self._publish_status()

    def _repeat_status(self) -> None:
        running = self._running
        # the final status is published together with the response
        if running is not None and running.machine.running:
            running.update_progress()
            self._publish_status()

    def _publish_status(self) -> None:
        shown = self._running or self._last
        values = shown.status() if shown is not None else self._first_status
        level = Level.OK if values['code'] in ('', 'OK') else Level.ERROR
        message = values['stage']
        self._status.publish(
            DiagnosticStatus(
                level=bytes([level]),
                name=self.get_fully_qualified_name().lstrip('/'),
                message=message,
                hardware_id=self.get_namespace().strip('/'),
                values=[KeyValue(key=key, value=value) for key, value in values.items()],
            )
        )
        self.status(message.lower())


def main() -> None:
    """Run the node."""
    sys.exit(run(Orchestrator))


if __name__ == '__main__':
    main()
