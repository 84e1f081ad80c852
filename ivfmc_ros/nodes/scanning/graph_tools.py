# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The tools of a scan, by the topics and services of the graph."""

from collections.abc import Callable
from collections.abc import Mapping
from dataclasses import dataclass
import math
from pathlib import Path
from typing import Any

from sensor_msgs.msg import CameraInfo

from ivfmc_ros.errors import BusyError
from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.errors import TimeoutExceededError
from ivfmc_ros.nodes.framework.adaptive_subscription import AdaptiveSubscription
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.futures import Condition
from ivfmc_ros.nodes.framework.futures import Helpers
from ivfmc_ros.nodes.scanning.cell_link import CellLink
from ivfmc_ros.nodes.scanning.cell_link import JOINTS
from ivfmc_ros.scan.job import Outcome
from ivfmc_ros.scan.machine import Machine
from ivfmc_ros.scan.plan import Motion
from ivfmc_ros.scan.plan import NOT_MEASURED
from ivfmc_ros.scan.plan import Plan
from ivfmc_ros.scan.plan import Sweep
from ivfmc_ros.scan.report import finish_scan
from ivfmc_ros.scan.request import ScanRequest

# They have no hardware of their own and belong to every scan.
NEEDED = ('triangulator', 'registrar', 'mesher', 'recorder')
# Others may stand in for these, without a heartbeat; ours are watched when they are there.
OPTIONAL = ('camera', 'turntable')

_NOT_RECORDED = 'NOT_RECORDED'

_FOREVER = 24 * 3600.0
_MESHING = 3600.0
_SLACK = 15.0
_COMING_UP = 15.0
_SETTLE_NS = 200_000_000
# so many profiles tell how fast they come
_RATED = 6


@dataclass(frozen=True, kw_only=True)
class ScanContext:
    """
    What is fixed while a scan runs.

    cell : path of cell.yaml
    tolerance : radians, of the table's positions
    patience : seconds, for one profile
    home : look for the table's home switch first
    """

    scan_id: str
    folder: Path
    request: ScanRequest
    plan: Plan
    motion: Motion
    cell: Path
    tolerance: float
    patience: float
    home: bool


class GraphTools:
    """Does what a scan needs done; every wait ends when somebody is lost or it is cancelled."""

    def __init__(
        self,
        node: CellNode,
        link: CellLink,
        helpers: Helpers,
        context: ScanContext,
        machine: Machine,
    ) -> None:
        self.context = context
        self.camera_info: Any = None
        self._node = node
        self._link = link
        self._machine = machine
        self._helpers = helpers
        # who is asked for the first time is not known yet
        for path in ('turntable/stop', 'registrar/cancel', 'mesher/cancel'):
            helpers.has(path)
        self._working = ''
        self._watched: list[str] = []
        self._recording = False
        self._stood_ns = 0
        self.bag: Mapping[str, Any] = {}
        self.picture_error = ''

    async def prepare(self) -> None:
        """Tell everybody which scan it is, and begin to record."""
        context = self.context
        self._link.forget()
        await self._require_cell()
        lasers = len(context.plan.sweeps[0].views)
        await self._helpers.set(
            'triangulator',
            {
                'view': [NOT_MEASURED] * lasers,
                'motion': context.request.motion,
                'subtract_dark': context.request.dark_frames,
                'scan_id': context.scan_id,
            },
        )
        await self._helpers.set('registrar', {'scan_id': context.scan_id})
        await self._helpers.trigger('registrar/reset', _SLACK, self._guard)
        place = {'scan_folder': str(context.folder), 'scan_id': context.scan_id}
        files = {'formats': context.request.formats, 'export_unit': context.request.export_unit}
        await self._helpers.set('mesher', {**place, **files})
        await self._helpers.set('recorder', {**place, 'pictures': True})
        # what was under way of the scan before
        self._link.forget()
        await self._start_recording()
        self.camera_info = await self._first(CameraInfo, 'camera_info', 'CAMERA_LOST')
        if context.home:
            await self._helpers.trigger('turntable/home', 120.0, self._guard)

    async def _start_recording(self) -> None:
        # one that answers too late records all the same, and has to be stopped
        self._recording = True
        try:
            await self._helpers.trigger('recorder/start', _SLACK, self._guard)
        except HelperError as error:
            if error.code != BusyError.code:
                raise
            # of a scan whose orchestrator was lost; nobody else will end it
            self._node.get_logger().warning(f'{error}; that is ended now')
            await self._stop_recording()
            self._recording = True
            await self._helpers.trigger('recorder/start', _SLACK, self._guard)

    async def _require_cell(self) -> None:
        """Wait for a cell that is just coming up, and say who is missing of one that does not."""
        watch = self._link.watch
        needed = [*NEEDED, JOINTS]
        try:
            await self._helpers.waiting.until(
                lambda: not watch.silent(needed) and self._link.has_table(),
                _COMING_UP,
                'the cell',
                self._machine.check,
            )
        except TimeoutExceededError:
            watch.require(NEEDED)
            if not self._link.has_table():
                raise HelperError('TURNTABLE_LOST', 'nobody takes joint_trajectory') from None
            watch.require([JOINTS])
        self._watched = needed + [name for name in OPTIONAL if not watch.silent([name])]

    async def select(self, sweep: Sweep) -> None:
        """Let profiles belong to the views of this sweep from now on."""
        await self._helpers.set('triangulator', {'view': list(sweep.views)})

    async def move(self, position: float, velocity: float) -> None:
        """Turn the table to a position (radians) at so many rad/s; return when it stands."""
        tolerance = self.context.tolerance
        if self._link.stands_at(position, 0.1 * tolerance):
            return
        here = self._link.position
        seconds = self.context.motion.seconds(position - (here or 0.0), velocity)
        self._link.send(position, seconds)
        await self._until(
            lambda: self._link.stands_at(position, tolerance),
            1.5 * seconds + _SLACK,
            f'the table to stand at {math.degrees(position):.2f} degrees',
            'MOTION_FAILED',
        )
        self._stood_ns = self._link.stood_ns

    async def light(self, laser: str) -> None:
        """Let this laser shine and no other, and return when it does."""
        self._link.hold(laser)
        await self._until(
            lambda: self._link.shines(laser), 10.0, f'laser {laser} to shine', 'LASER_FAILED'
        )

    def dark(self) -> None:
        """Let all lasers go out."""
        self._link.hold(None)

    async def dark_frame(self) -> None:
        """Return when a picture was taken with all lasers off where the table stands."""
        link, name = self._link, 'all lasers to be off'
        await self._until(lambda: link.dark_since_ns is not None, 10.0, name, 'LASER_FAILED')
        # the triangulator wants the table to have stood for a while before
        begin = max(link.dark_since_ns or 0, self._stood_ns + _SETTLE_NS)
        patience = self.context.patience
        await self._until(
            lambda: link.pictured_ns >= begin, patience, 'a dark picture', 'CAMERA_LOST'
        )

    async def profile_of(self, view: int) -> None:
        """Return when a view has its profile of where the table stands."""
        stood_ns = self._stood_ns

        def there() -> bool:
            return any(
                head.view == view and head.stamp_ns >= stood_ns for head in self._link.latest()
            )

        await self._until(there, self.context.patience, f'a profile of view {view}', 'NO_PROFILE')

    async def rate(self, sweep: Sweep) -> float:
        """Return how many profiles a second come of the laser that shines, the table standing."""
        wanted = max(sweep.views)

        def stamps() -> list[int]:
            heads = self._link.latest()
            return sorted(h.stamp_ns for h in heads if h.view == wanted)[-_RATED:]

        await self._until(
            lambda: len(stamps()) == _RATED,
            self.context.patience,
            f'the first profiles of view {wanted}',
            'NO_PROFILE',
        )
        first, *_, last = stamps()
        rate = (_RATED - 1) / max((last - first) * 1e-9, 1e-3)
        if rate < 0.9 * self.context.motion.profile_rate:
            self._node.get_logger().warning(
                f'{rate:.1f} profiles a second come, not {self.context.motion.profile_rate:.1f}; '
                'the table turns slower'
            )
        return rate

    async def settled(self, sweep: Sweep) -> None:
        """Return when every picture of the sweep has become a profile."""
        # pictures become profiles in their order, and one of the table that stands is the last
        await self.profile_of(max(sweep.views))

    async def resumed(self) -> None:
        """Return when the scan shall go on."""
        await self._until(lambda: not self._machine.pausing, _FOREVER, 'resume', 'TIMEOUT')

    async def recorded(self) -> None:
        """Return when every profile is in the bag."""
        if not self._link.heads:
            raise HelperError('NO_PROFILE', 'the scan has no profile')
        # a laser that nobody can turn off gives profiles on and on
        await self._measure_none()

        def complete() -> bool:
            recorded = self._link.recorded
            return recorded is not None and recorded >= max(self._link.heads)

        await self._until(complete, 60.0, 'the recorder to write all profiles', _NOT_RECORDED)
        # dark pictures while the mesh is made would be most of the bag
        await self._helpers.set('recorder', {'pictures': False})
        # camera and table may be turned off from now on
        self._watched = ['registrar', 'mesher', 'recorder']

    async def _measure_none(self) -> None:
        lasers = len(self.context.plan.sweeps[0].views)
        await self._helpers.set('triangulator', {'view': [NOT_MEASURED] * lasers})

    async def register(self) -> Mapping[str, Any]:
        """Bring the views together, and return what is said of them."""
        await self._helpers.set('registrar', {'expected': max(self._link.heads) + 1})
        return await self._work('registrar', 'register')

    async def build(self) -> Mapping[str, Any]:
        """Make the mesh, and return what is said of it."""
        return await self._work('mesher', 'build')

    async def _work(self, node: str, service: str) -> Mapping[str, Any]:
        self._working = node
        answer = await self._helpers.trigger(f'{node}/{service}', _MESHING, self._guard)
        self._working = ''
        return answer

    async def finish(self, outcome: Outcome) -> None:
        """Close the bag and write what belongs to the scan."""
        self.bag = await self._stop_recording()
        folder, bag = self.context.folder, self.bag
        self.picture_error = await self.in_thread(finish_scan, folder, outcome, bag)

    async def in_thread(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Run what waits for a disk, while the node goes on."""
        return await self._node.in_thread(function, *arguments)

    async def halt(self, outcome: Outcome) -> None:
        """Stop the table and close the bag, as far as that is possible; never raises."""
        self._link.halt()
        if self._helpers.has('turntable/stop'):
            await self._quietly(self._helpers.trigger('turntable/stop', 5.0))
        if self._working and self._helpers.has(f'{self._working}/cancel'):
            # who goes on with what nobody waits for is busy when the next scan comes
            await self._quietly(self._helpers.trigger(f'{self._working}/cancel', 5.0))
        if 'triangulator' in self._watched and not self._link.watch.silent(['triangulator']):
            await self._quietly(self._measure_none())
        if self._recording:
            trouble = await self._quietly(self._stop_recording())
            if trouble and outcome.code == _NOT_RECORDED:
                outcome.detail = f'{outcome.detail}: {trouble}'

    async def _stop_recording(self) -> Mapping[str, Any]:
        self._recording = False
        return await self._helpers.trigger('recorder/stop', 120.0)

    async def _first(self, kind: type, topic: str, code: str) -> Any:
        got: list[Any] = []
        subscription = AdaptiveSubscription(self._node, kind, topic, got.append)
        try:
            await self._until(lambda: bool(got), _SLACK, f'a message on {topic}', code)
        finally:
            subscription.destroy()
        return got[0]

    async def _until(self, condition: Condition, seconds: float, what: str, code: str) -> None:
        try:
            await self._helpers.waiting.until(condition, seconds, what, self._guard)
        except TimeoutExceededError as error:
            raise HelperError(code, str(error)) from error

    def _guard(self) -> None:
        self._machine.check()
        self._link.watch.require(self._watched)
        self._link.require_one_count()
        seconds = self._link.unrecorded_s
        if self._recording and seconds > self.context.patience:
            raise HelperError(
                _NOT_RECORDED, f'the recorder has not written a profile for {seconds:.1f} s'
            )

    async def _quietly(self, work: Any) -> str:
        """Return what went wrong, or ''."""
        try:
            await work
        except ScanError as error:
            self._node.get_logger().warning(f'while ending the scan: {error}')
            return str(error)
        return ''
