# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The exposure times of a scan that takes every sweep with several of them.

What camera and triangulator had before is kept in a file while the scan has them: where the
orchestrator was killed, its next scan gives them back.
"""

from collections.abc import Callable
from collections.abc import Iterable
from collections.abc import Mapping
from collections.abc import Sequence
import json
from pathlib import Path

from sensor_msgs.msg import CameraInfo

from ivfmc_ros import files
from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.nodes.convert.stamps import nanoseconds
from ivfmc_ros.nodes.framework.adaptive_subscription import AdaptiveSubscription
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.futures import ServiceClients
from ivfmc_ros.nodes.scanning.beam_control import Until

# In the folder of the scans: ``exposure`` of each node before the scan, and those of the scan.
FILE_NAME = 'exposures_before_scan.json'
_NODES = ('camera', 'triangulator')
# Within which the images with a new exposure time come, seconds: on a busy machine.
_IMAGES_S = 15.0
# Images after a change of the exposure time before one is sure to have the new one: a camera that
# exposes while it reads out has begun the next one.
_SETTLING_IMAGES = 3
# An exposure time is far from that of the calibration at more than so many times, or less.
_MAX_RATIO = 4.0


def exposure_text(present: float, calibrated: float) -> str:
    """Return a warning where an exposure time is far from that of the calibration; or ''."""
    if not calibrated > 0.0 or 1.0 / _MAX_RATIO <= present / calibrated <= _MAX_RATIO:
        return ''
    return (
        f'the camera exposes for {1e3 * present:g} ms, in the calibration of the lasers it did '
        f'for {1e3 * calibrated:g} ms: the stripes are not those that were calibrated; give the '
        'camera its exposure back, or calibrate the lasers with the new one'
    )


class ExposureControl:
    """The part of ``scan.job.Tools`` that concerns exposure times."""

    def __init__(
        self,
        node: CellNode,
        services: ServiceClients,
        until: Until,
        guard: Callable[[], None],
        exposures: Iterable[float],
        folder: Path,
    ) -> None:
        """
        Make the control of one scan.

        exposures : exposure times that the scan sets, seconds; 0 is none
        folder : of the scan, in the folder of the scans
        """
        self._node, self._services, self._until, self._guard = node, services, until, guard
        self._exposures = sorted({seconds for seconds in exposures if seconds})
        self._folder, self._file = folder, folder.parent / FILE_NAME
        # parameter ``exposure`` of each node before the scan
        self._own: dict[str, float] = {}
        self._present = 0.0

    async def prepare(self) -> None:
        """
        Try all exposure times of the scan, before the table turns.

        :raises ParameterError: the camera has no parameter for it
        :raises HelperError: it refuses one of them
        :raises FileError: the folder of the scans cannot be written
        """
        await self._give_back_what_was_left()
        if not self._exposures:
            return
        own = {node: await self._exposure_of(node) for node in _NODES}
        set_ones = [*self._exposures, *(self._matched(own, one) for one in self._exposures)]
        files.write_text(self._file, json.dumps({'own': own, 'set': set_ones}) + '\n')
        self._own = own
        for seconds in self._exposures:
            await self._set(seconds)

    async def doubts(self) -> list[str]:
        """
        Return what the exposure of the camera says about the calibration, if both are known.

        :raises ScanError: cell.yaml of the scan cannot be read
        """
        calibrated = load_draft(self._folder / 'cell.yaml').notes.get('exposure')
        if self._exposures or not isinstance(calibrated, int | float):
            return []
        try:
            present = await self._services.get('camera', 'exposure', self._guard)
        except HelperError:
            # a driver of another name
            return []
        if not isinstance(present, float):
            return []
        text = exposure_text(present, float(calibrated))
        return [text] if text else []

    async def _give_back_what_was_left(self) -> None:
        """Undo what a scan whose orchestrator was killed has set, unless it was changed since."""
        try:
            kept = json.loads(self._file.read_text(encoding='utf-8'))
            own, known = dict(kept['own']), list(kept['set'])
        except FileNotFoundError:
            return
        except (OSError, ValueError, KeyError, TypeError) as error:
            self._node.get_logger().warning(f'{self._file}: is not read: {error}')
            self._file.unlink(missing_ok=True)
            return
        for node in _NODES:
            try:
                await self._give_back(node, own.get(node), known)
            except HelperError as error:
                # another driver by now
                self._node.get_logger().warning(f'{node}: exposure is not given back: {error}')
        self._file.unlink(missing_ok=True)

    async def _give_back(self, node: str, seconds: float | None, known: Sequence[float]) -> None:
        present = await self._services.get(node, 'exposure', self._guard)
        if seconds is None or present not in known:
            return
        await self._services.set(node, {'exposure': seconds}, self._guard)
        self._node.get_logger().info(
            f'{node}: exposure is {1e3 * seconds:g} ms again, as before an interrupted scan'
        )

    async def _exposure_of(self, node: str) -> float:
        try:
            own = await self._services.get(node, 'exposure', self._guard)
        except HelperError as error:
            # a driver of another name
            own, reason = None, f' ({error})'
        else:
            reason = ''
        if isinstance(own, float):
            return own
        raise ParameterError(
            f'exposures: the node {node} has no parameter exposure{reason}; leave exposures '
            'empty, and set the exposure time of the camera by its own means'
        )

    async def expose(self, seconds: float) -> None:
        """Set the exposure time; return when images with it have come. 0: leave it."""
        if not seconds or seconds == self._present:
            return
        await self._set(seconds)
        stamps: list[int] = []
        changed_ns = self._node.now_ns()

        def receive(info: CameraInfo) -> None:
            stamp_ns = nanoseconds(info.header.stamp)
            if stamp_ns > changed_ns:
                stamps.append(stamp_ns)

        subscription = AdaptiveSubscription(self._node, CameraInfo, 'camera_info', receive)
        try:
            await self._until(
                lambda: len(stamps) > _SETTLING_IMAGES,
                _IMAGES_S + _SETTLING_IMAGES * seconds,
                f'images with an exposure time of {1e3 * seconds:g} ms',
                'CAMERA_LOST',
            )
        finally:
            subscription.destroy()
        self._present = seconds

    async def _set(self, seconds: float) -> None:
        # before the call: after a time-out the camera may have it all the same
        self._present = 0.0
        await self._services.set('camera', {'exposure': seconds}, self._guard)
        matched = {'exposure': self._matched(self._own, seconds)}
        await self._services.set('triangulator', matched, self._guard)

    @staticmethod
    def _matched(own: Mapping[str, float], seconds: float) -> float:
        """Return the parameter of the triangulator: an image may not be longer than it says."""
        return max(seconds, own['triangulator'])

    async def release(self) -> None:
        """
        Give camera and triangulator back what they had before the scan; may be called again.

        :raises HelperError: one of them does not take it; the next scan tries again
        """
        own, self._own = self._own, {}
        for node, seconds in own.items():
            await self._services.set(node, {'exposure': seconds})
        if own:
            self._file.unlink(missing_ok=True)
