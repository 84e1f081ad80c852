# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The steps of a scan (``scan.job.Tools``) by the topics and services of the other nodes."""

from collections.abc import Callable
from collections.abc import Mapping
from collections.abc import Sequence
import math
from typing import Any

from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.errors import TimeoutExceededError
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.futures import Condition
from ivfmc_ros.nodes.framework.futures import ServiceClients
from ivfmc_ros.nodes.scanning.beam_control import BeamControl
from ivfmc_ros.nodes.scanning.camera_control import CameraControl
from ivfmc_ros.nodes.scanning.cell_link import CellLink
from ivfmc_ros.nodes.scanning.cell_ready import wait_for_cell
from ivfmc_ros.nodes.scanning.exposure_control import ExposureControl
from ivfmc_ros.nodes.scanning.mesh_verdict import judge_mesh
from ivfmc_ros.nodes.scanning.profile_wait import ProfileWait
from ivfmc_ros.nodes.scanning.recording_control import RecordingControl
from ivfmc_ros.nodes.scanning.scan_checks import ScanChecks
from ivfmc_ros.nodes.scanning.scan_context import ScanContext
from ivfmc_ros.nodes.scanning.scan_guard import NOT_RECORDED
from ivfmc_ros.nodes.scanning.scan_guard import ScanGuard
from ivfmc_ros.nodes.scanning.scan_temperature import record_temperature
from ivfmc_ros.nodes.scanning.table_motion import TableMotion
from ivfmc_ros.nodes.scanning.warm_up import WarmUp
from ivfmc_ros.scan.disk_space import DiskWatch
from ivfmc_ros.scan.job import Outcome
from ivfmc_ros.scan.plan import LOW_RATE
from ivfmc_ros.scan.plan import NOT_MEASURED
from ivfmc_ros.scan.plan import require_steps
from ivfmc_ros.scan.plan import Sweep
from ivfmc_ros.scan.report import write_figures
from ivfmc_ros.scan.state_machine import StateMachine
from ivfmc_ros.scan.table_reports import Standstill
from ivfmc_ros.storage.messages.camera_info import to_camera

# Time-outs, seconds.
_PAUSE_S = 24 * 3600.0
# registration or meshing: minutes for millions of points
_PROCESSING_S = 3600.0
# a short service call or the first message of a topic, on a busy machine; also added to a move
_RESPONSE_S = 15.0
_HOMING_S = 120.0
_FLUSH_S = 60.0
# the registrar reads the bag of an interrupted scan
_LOAD_S = 120.0
_ABORT_S = 5.0
_ABORT_RECORDER_S = 10.0


class GraphTools:
    """
    Implements ``scan.job.Tools``.

    Every wait ends with an error when a node is lost or the scan is cancelled.

    camera_info : first message of the scan
    bag : response of the recorder
    has_figures : report.json is written, from which the report can be rendered
    on_begin : called when a sweep begins
    """

    def __init__(
        self,
        node: CellNode,
        link: CellLink,
        services: ServiceClients,
        context: ScanContext,
        machine: StateMachine,
    ) -> None:
        self.context = context
        self.camera_info: Any = None
        self.on_begin: Callable[[], None] = lambda: None
        self._node = node
        self._link = link
        self._machine = machine
        self._services = services
        self._checks = ScanChecks(
            link, context.plan, context.motion, context.limits, context.scan_id
        )
        resumed = self._resumed = context.resumed
        if resumed is not None:
            self._checks.take_over(resumed.course)
        # discovery starts with the first call
        for path in ('turntable/stop', 'registrar/cancel', 'mesher/cancel'):
            services.has(path)
        self._working = ''
        # a controller with a home switch is locked when its supply comes on
        disk = DiskWatch(context.folder, context.reserve)
        self._guard = ScanGuard(
            machine,
            link,
            context.patience,
            disk,
            needs_homing=context.home,
            scan_id=context.scan_id,
        )
        self._recording = RecordingControl(
            node, link, services, self._guard, resumed=resumed is not None
        )
        self._beam = BeamControl(node, link, self._until, context.patience, context.scan_id)
        self._profiles = ProfileWait(link, self._until, context.patience)
        triggered = any(sweep.trigger_step for sweep in context.plan.sweeps)
        self._camera = CameraControl(node, services, self._until, self._guard, triggered=triggered)
        exposures = [sweep.exposure for sweep in context.plan.sweeps]
        self._exposure = ExposureControl(
            node, services, self._until, self._guard, exposures, context.folder
        )
        self._warm_up = WarmUp(link, self._until, context.scan_id, context.request.warm_up)
        self._standstill = Standstill()
        self.bag: Mapping[str, Any] = {}
        self.has_figures = False

    async def prepare(self) -> None:
        """Send the id and the settings of the scan to the nodes, and start the recorder."""
        context, resumed = self.context, self._resumed
        # before the id of the scan, with which the numbers of the profiles begin anew
        first = {'first_profile': resumed.first_profile if resumed else 0}
        self._link.start_scan()
        self._guard.watched = await wait_for_cell(self._services, self._link, self._machine)
        await self._set(
            'triangulator',
            {
                **self._no_views(),
                'motion': context.request.motion,
                'subtract_dark': context.request.dark_frames,
                **first,
                'scan_id': context.scan_id,
            },
        )
        await self._set('registrar', {**first, 'scan_id': context.scan_id})
        await self._services.trigger('registrar/reset', _RESPONSE_S, self._guard)
        scan = {'scan_folder': str(context.folder), 'scan_id': context.scan_id}
        files = {'formats': context.request.formats, 'export_unit': context.request.export_unit}
        await self._set('mesher', {**scan, **files, **await self._working_volume()})
        owner = self._node.life.id
        await self._set('recorder', {**scan, **first, 'pictures': True, 'owner': owner})
        # messages of the previous scan that were still in the queues
        self._link.start_scan()
        await self._recording.start()
        if resumed is not None:
            self._link.take_over(resumed.taken)
            await self._services.trigger('registrar/load', _LOAD_S, self._guard)
        self.camera_info = await self._camera.first_info()
        await self._exposure.prepare()
        self._checks.notes += await self._exposure.doubts()
        if resumed is not None:
            resumed.require_camera(to_camera(self.camera_info))
            await self._stop_table()
        await self._require_steps()
        if context.home:
            await self._services.trigger('turntable/home', _HOMING_S, self._guard)
            # the diagnostics may be received after the response
            await self._until(self._is_unlocked, _RESPONSE_S, 'unlocking', 'CONTROLLER_ALARM')
            self._guard.needs_homing = False

    async def _stop_table(self) -> None:
        """Stop a table that still makes the move of an orchestrator that died."""

        def stands() -> bool:
            return self._link.table.stands_at(self.position, self.context.tolerance)

        if not stands():
            self._link.halt()
            await self._until(stands, _RESPONSE_S, 'the table to stop', 'MOTION_FAILED')

    @property
    def begun(self) -> Sequence[Sweep]:
        """The sweeps that have begun, as they were executed."""
        return self._checks.executed

    def _is_unlocked(self) -> bool:
        return not self._link.diagnostics.controller_code

    async def _working_volume(self) -> dict[str, float]:
        """Return the limits by which the mesher tells a rim that the volume cut."""
        limits = {}
        for name in ('radius', 'top'):
            value = await self._services.get('triangulator', f'volume.{name}', self._guard)
            limits[f'working_{name}'] = max(0.0, float(value or 0.0))
        return limits

    async def _require_steps(self) -> None:
        """:raises ParameterError: the triangulator takes two stops for one position."""
        if self.context.request.motion == 'step':
            least = await self._services.get('triangulator', 'min_step', self._guard)
            require_steps(self.context.plan, float(least or 0.0), 'min_step of the triangulator')

    async def select_views(self, sweep: Sweep) -> None:
        """Set the view numbers of this sweep for the profiles that follow."""
        self._checks.begin(sweep)
        # on disk before its first profile
        self.on_begin()
        await self._set('triangulator', {'view': list(sweep.views)})

    async def move(self, position: float, velocity: float) -> None:
        """Turn the table to ``position`` (rad) at ``velocity`` (rad/s); return at standstill."""
        context = self.context
        motion = TableMotion(self._link, context.motion, context.tolerance, position, velocity)
        if not motion.is_needed:
            return
        motion.command()
        await self._until(
            motion.has_arrived,
            1.5 * motion.seconds + _RESPONSE_S,
            f'the table to stop at {math.degrees(position):.2f} degrees',
            'MOTION_FAILED',
        )
        self._standstill = self._link.table.standstill

    async def laser_on(self, laser: str) -> None:
        """Switch this laser on and all others off; return when that is reported."""
        await self._beam.turn_on(laser)

    def lasers_off(self) -> None:
        """Command all lasers off; does not wait."""
        self._link.hold(None)

    async def warm_up(self, sweep: Sweep) -> None:
        """Return when the stripes of the lasers rest, or after the longest time for it."""
        if not self.context.request.warm_up or sweep.retake_of is not None:
            return
        # no profiles and no recorded images of it
        await self._set('triangulator', self._no_views())
        await self._set('recorder', {'pictures': False})
        used = [index for index, view in enumerate(sweep.views) if view != NOT_MEASURED]
        for laser, index in zip(sweep.lasers, used, strict=True):
            await self.laser_on(laser)
            if moving := await self._warm_up.wait(laser, index, sweep):
                self._node.get_logger().warning(moving)
                self._checks.notes.append(moving)
        await self._set('recorder', {'pictures': True})

    async def take_dark_frame(self) -> None:
        """Return when an image was exposed with all lasers off at the present position."""
        await self._beam.take_dark_frame(self._standstill.first_ns)

    async def check_lasers_off(self) -> None:
        """Return when images were exposed with all lasers off, in which one may still shine."""
        await self._beam.check_off()

    async def wait_for_profile(self, view: int) -> None:
        """Return when a profile of ``view`` at the present position has been received."""
        await self._profiles.profile_at(view, self._standstill)

    async def measure_profile_rate(self, sweep: Sweep) -> float:
        """Return the rate of profiles, 1/s, with the present laser at standstill."""
        planned = self.context.motion.profile_rate
        rate = await self._profiles.rate(max(sweep.views), LOW_RATE * planned)
        if rate < LOW_RATE * planned:
            self._node.get_logger().warning(
                f'measured {rate:.1f} profiles/s, planned {planned:.1f}; '
                'the table turns more slowly'
            )
        return rate

    async def expose(self, seconds: float) -> None:
        """Set the exposure time of the images; return when images have it. 0: leave it."""
        await self._exposure.expose(seconds)

    async def trigger_camera(self, *, on: bool) -> None:
        """Start each exposure by the table's trigger, or at the camera's own rate."""
        await self._camera.trigger(on=on)

    async def wait_for_sweep_profiles(self, sweep: Sweep) -> None:
        """Return when all images of the sweep have been processed."""
        # images are processed in order, and the last one is exposed at standstill
        await self.wait_for_profile(max(sweep.views))

    @property
    def position(self) -> float:
        """Position of the table, radians."""
        return self._link.position or 0.0

    def remaining(self, sweep: Sweep) -> Sequence[Sweep]:
        """Return the sweeps that take what is missing of a sweep that was interrupted."""
        return self._checks.remaining(sweep)

    def retakes(self, sweep: Sweep) -> Sequence[Sweep]:
        """Return the sweeps that take the missing angles of ``sweep`` again; none if complete."""
        return self._checks.retakes(sweep)

    async def wait_until_resumed(self) -> None:
        """Return when the operator resumes the scan."""
        await self._until(lambda: not self._machine.pause_requested, _PAUSE_S, 'resume', 'TIMEOUT')

    async def wait_until_recorded(self) -> None:
        """Return when every profile is in the bag."""
        if not self._link.headers:
            raise HelperError('NO_PROFILE', 'the scan has no profile')
        # a laser that is always on would produce profiles without end
        await self._set('triangulator', self._no_views())

        def complete() -> bool:
            recorded = self._link.recorded
            return recorded is not None and recorded >= max(self._link.headers)

        await self._until(complete, _FLUSH_S, 'the recorder to write all profiles', NOT_RECORDED)
        # dark images during meshing would be most of the bag
        await self._set('recorder', {'pictures': False})
        await self._log_error(self._exposure.release())
        # camera and table are not needed any more
        self._guard.needs_images = False
        self._guard.watched = ['registrar', 'mesher', 'recorder']

    def _no_views(self) -> dict[str, Any]:
        return {'view': [NOT_MEASURED] * len(self.context.plan.sweeps[0].views)}

    async def _set(self, node: str, values: dict[str, Any]) -> None:
        await self._services.set(node, values, self._guard)

    async def register(self) -> Mapping[str, Any]:
        """Register all views; return the registrar's response."""
        await self._set('registrar', {'expected': max(self._link.headers) + 1})
        answer = await self._call_long('registrar', 'register')
        if answer.get('stamp_ns'):
            # poses of another scan that arrive late must not become the mesh of this one
            await self._set('mesher', {'poses_stamp': answer['stamp_ns']})
        return answer

    def judge(self, outcome: Outcome) -> None:
        """Set the code of the outcome where what came is not what the plan asked for."""
        record_temperature(self._node, self._link, self.context.folder, outcome)
        self._checks.judge(outcome)

    async def build_mesh(self) -> Mapping[str, Any]:
        """Build the mesh and its files; return the mesher's response."""
        return await self._call_long('mesher', 'build')

    async def _call_long(self, node: str, service: str) -> Mapping[str, Any]:
        self._working = node
        answer = await self._services.trigger(f'{node}/{service}', _PROCESSING_S, self._guard)
        self._working = ''
        return answer

    @property
    def inspects(self) -> bool:
        """Whether the recipe of the scan judges its mesh."""
        return self.context.inspects

    async def inspect(self, outcome: Outcome) -> Mapping[str, Any]:
        """Judge the mesh by the recipe."""
        return await judge_mesh(self.context, outcome, self._until)

    async def finish(self, outcome: Outcome) -> None:
        """Close the bag and write the figures of the scan; its images are rendered later."""
        self.bag = await self._recording.stop()
        last = max(self._link.headers)
        # older recorders answer without the number
        if self.bag.get('recorded', last) != last:
            text = f'the bag ends with profile {self.bag["recorded"]} instead of {last}'
            raise HelperError(NOT_RECORDED, text)
        folder, bag = self.context.folder, self.bag
        await self.in_thread(write_figures, folder, outcome, bag)
        self.has_figures = True

    async def in_thread(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Run blocking work in a thread and return its result."""
        return await self._node.in_thread(function, *arguments)

    async def abort(self, outcome: Outcome) -> None:
        """Stop the table and close the bag as far as possible; never raises."""
        self._link.halt()
        # a working node: otherwise it is busy when the next scan starts
        for node, service in (('turntable', 'stop'), (self._working, 'cancel')):
            if not self._guard.is_lost(node) and self._services.has(f'{node}/{service}'):
                await self._log_error(self._services.trigger(f'{node}/{service}', _ABORT_S))
        await self._log_error(self._camera.release())
        await self._log_error(self._exposure.release())
        if 'triangulator' in self._guard.watched and not self._guard.is_lost('triangulator'):
            await self._log_error(self._services.set('triangulator', self._no_views()))
        if self._guard.recording:
            error = await self._log_error(self._recording.stop(_ABORT_RECORDER_S))
            if error and outcome.code == NOT_RECORDED:
                outcome.detail = f'{outcome.detail}: {error}'

    async def _until(self, condition: Condition, seconds: float, what: str, code: str) -> None:
        try:
            await self._services.waiter.until(condition, seconds, what, self._guard)
        except TimeoutExceededError as error:
            raise HelperError(code, str(error)) from error

    async def _log_error(self, work: Any) -> str:
        """Await ``work``; log and return its error, '' without one."""
        try:
            await work
        except ScanError as error:
            self._node.get_logger().warning(f'while aborting the scan: {error}')
            return str(error)
        return ''
