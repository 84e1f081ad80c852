# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Prepares an interrupted scan to be resumed by the orchestrator."""

from pathlib import Path

from ivfmc_ros.errors import BusyError
from ivfmc_ros.errors import CellError
from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import ResumeError
from ivfmc_ros.errors import StateError
from ivfmc_ros.errors import TimeoutExceededError
from ivfmc_ros.files import folder_below
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.futures import ServiceClients
from ivfmc_ros.nodes.scanning.cell_link import CellLink
from ivfmc_ros.scan import scan_folder
from ivfmc_ros.scan.resume import InterruptedScan
from ivfmc_ros.scan.resume import last_interrupted
from ivfmc_ros.scan.resume import load_interrupted
from ivfmc_ros.scan.resume import require_scan_id
from ivfmc_ros.storage.recording.taken_profiles import is_being_recorded

# Seconds to wait for the diagnostics of turntable, which are published once a second; a table of
# another driver has none.
_DIAGNOSTICS_S = 4.0
# Seconds that a recorder may take to close the bag of an orchestrator that died.
_CLOSE_S = 120.0


class Resumption:
    """
    Loads the scan that the parameter ``resume_scan`` names.

    loading : id of the scan that is being loaded, '' for none
    """

    def __init__(self, node: CellNode, link: CellLink, services: ServiceClients) -> None:
        self._node, self._link, self._services = node, link, services
        self.loading = ''

    def require_idle(self) -> None:
        """:raises BusyError: a scan is being loaded."""
        if self.loading:
            raise BusyError(
                f'scan {self.loading} is being loaded to be resumed', scan_id=self.loading
            )

    async def load(self) -> tuple[InterruptedScan, bool]:
        """
        Return the scan, and whether the table has to be homed first.

        :raises StateError: ``resume_scan`` is empty
        :raises ScanError: the scan cannot be resumed; the error names what is in the way
        """
        self.require_idle()
        root = Path(self._node.get('scan_root')).absolute()
        name = self._node.get('resume_scan')
        if not name:
            last = await self._node.in_thread(last_interrupted, root)
            raise StateError(
                'no scan is running or paused; to resume an interrupted one, set the parameter '
                f'resume_scan to its id{f", such as {last}" if last else " (there is none)"}'
            )
        folder = folder_below(root, require_scan_id(name), 'resume_scan')
        if not self._node.get('cell'):
            raise CellError('orchestrator: cell: is empty; set it to the path of cell.yaml')
        self.loading = name
        try:
            if not folder.is_dir():
                last = await self._node.in_thread(last_interrupted, root)
                raise ResumeError(
                    f'{root}: has no scan {name!r}; the last one that can be resumed is '
                    f'{last or "none"}'
                )
            if await self._node.in_thread(is_being_recorded, folder):
                await self._end_recording(folder)
            cell = Path(self._node.get('cell'))
            scan = await self._node.in_thread(_load_locked, folder, cell)
            return scan, scan.needs_homing(await self._zero())
        finally:
            self.loading = ''

    async def _end_recording(self, folder: Path) -> None:
        """Stop the recording of an orchestrator that died; the recorder may be doing so itself."""
        try:
            await self._services.trigger('recorder/stop', _CLOSE_S)
        except HelperError as error:
            self._node.get_logger().info(f'recording of scan {folder.name}: {error}')
        await self._services.waiter.until(
            lambda: not is_being_recorded(folder), _CLOSE_S, 'the recorder to close the bag'
        )

    async def _zero(self) -> str:
        """Return the identity of the table's zero, '' if its driver names none."""
        diagnostics = self._link.diagnostics
        try:
            await self._services.waiter.until(
                lambda: diagnostics.zero is not None, _DIAGNOSTICS_S, 'diagnostics of turntable'
            )
        except TimeoutExceededError:
            return ''
        return diagnostics.zero or ''


def _load_locked(folder: Path, cell: Path) -> InterruptedScan:
    with scan_folder.lock_scan(folder) as free:
        if not free:
            raise ResumeError(f'{folder.name}: another orchestrator runs it')
        return load_interrupted(folder, cell)
