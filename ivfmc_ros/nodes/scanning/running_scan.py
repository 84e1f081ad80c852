# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One scan from the moment it is accepted: its files, its rows, its status, its answer."""

from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field
from pathlib import Path
import shutil
import time
from typing import Any

from rclpy.task import Future

from ivfmc_ros.cell.camera_file import save_camera
from ivfmc_ros.cell.cell_file import CellDraft
from ivfmc_ros.cell.cell_file import save_draft
from ivfmc_ros.errors import ScanError
from ivfmc_ros.nodes.framework.json_response import text
from ivfmc_ros.nodes.scanning.cell_link import CellLink
from ivfmc_ros.nodes.scanning.graph_tools import GraphTools
from ivfmc_ros.nodes.scanning.graph_tools import ScanContext
from ivfmc_ros.scan import record
from ivfmc_ros.scan.job import Outcome
from ivfmc_ros.scan.job import run_job
from ivfmc_ros.scan.machine import Machine
from ivfmc_ros.scan.machine import Stage
from ivfmc_ros.scan.progress import Progress
from ivfmc_ros.storage.catalogue import Catalogue
from ivfmc_ros.storage.catalogue_writer import Notes
from ivfmc_ros.storage.messages.camera_info import camera_of

# The node does nothing else while it waits for the catalogue.
_PATIENCE_S = 2.0

# the keys of scan_status are fixed: somebody's gateway reads them
_KEYS = (
    'scan_id',
    'stage',
    'views_done',
    'views_total',
    'profiles_done',
    'profiles_total',
    'eta_s',
    'code',
    'result',
)


@dataclass(kw_only=True)
class RunningScan:
    """
    A scan that was accepted.

    ended : becomes the answer
    """

    context: ScanContext
    machine: Machine
    tools: GraphTools
    link: CellLink
    ended: Future
    result: Mapping[str, Any] | None = None
    detail: str = ''
    _notes: Notes = field(init=False)
    _progress: Progress = field(init=False)

    def __post_init__(self) -> None:
        self._progress = Progress(self.context.plan, self.context.motion, time.monotonic)

    @property
    def scan_id(self) -> str:
        """Name of the scan and of its folder."""
        return self.context.scan_id

    @property
    def folder(self) -> Path:
        """Where everything of the scan goes."""
        return self.context.folder

    def accepted(self, draft: CellDraft, parameters: Mapping[str, Any]) -> None:
        """
        Write what the scan is taken with, and its row in the catalogue.

        :raises ScanError: it cannot be written; then nothing is left of it
        """
        try:
            save_draft(self.folder / 'cell.yaml', draft)
            record.save_parameters(self.folder, parameters)
            self._save()
            catalogue = Catalogue(self.folder.parent, create=True, patience_s=_PATIENCE_S)
            request = self.context.request
            catalogue.add_scan(
                self.scan_id, request.part, request.recipe, str(Stage.IDLE), request.as_dict()
            )
        except ScanError:
            shutil.rmtree(self.folder, ignore_errors=True)
            raise
        self._notes = Notes(catalogue)

    async def run(self) -> dict[str, Any]:
        """Take the scan to its end and return the answer."""
        # another orchestrator of the same folder must not take it for one that was interrupted
        with record.claimed(self.folder):
            return await self._run()

    async def _run(self) -> dict[str, Any]:
        outcome = await run_job(self.machine, self.context.plan, self.context.motion, self.tools)
        answer = self._answer(outcome)
        self._save(outcome)
        self._note(outcome.code)
        if outcome.code == 'OK':
            scan_id, result = self.scan_id, dict(answer)
            self._notes.add(lambda catalogue: catalogue.add_result(scan_id, scan_id, result))
        await self.tools.in_thread(self._notes.close)
        error = self._notes.error or self.tools.bag.get('catalogue_error')
        if error:
            answer['catalogue_error'] = error
        self.result = answer
        return dict(answer)

    def _note(self, code: str = '') -> None:
        """Note the stage in the catalogue; one that cannot be written is no end of a scan."""
        stage = str(self.machine.stage)
        self._notes.add(lambda catalogue: catalogue.set_stage(self.scan_id, stage, code))

    def changed(self) -> None:
        """Note a change of stage where it outlives this process."""
        stage = self.machine.stage
        self._progress.at_stage(stage)
        if stage is Stage.SCANNING and not (self.folder / 'camera.yaml').exists():
            save_camera(self.folder / 'camera.yaml', camera_of(self.tools.camera_info))
        self._save()
        self._note()

    def counted(self) -> None:
        """Bring the counts up to date."""
        if self.machine.stage in (Stage.IDLE, Stage.PREPARING):
            # what the recorder says until then is of the scan before
            return
        if self.link.recorded is not None:
            self._progress.recorded(self.link.recorded + 1)
        heads = self.link.heads
        if heads:
            self._progress.in_view(heads[max(heads)].view)

    def interrupted(self) -> None:
        """Note that this process ends before the scan does."""
        try:
            record.mark_interrupted(self.folder)
        except ScanError:
            # it will be noted at the next start
            return
        failed = str(Stage.FAILED)
        self._notes.add(lambda catalogue: catalogue.set_stage(self.scan_id, failed, 'INTERRUPTED'))
        self._notes.close()

    def status(self) -> dict[str, str]:
        """Return the values of ``scan_status``."""
        progress = self._progress
        result = self.result
        return {
            'scan_id': self.scan_id,
            'stage': str(self.machine.stage),
            'views_done': str(progress.views_done),
            'views_total': str(self.context.plan.views),
            'profiles_done': str(progress.profiles_done),
            'profiles_total': str(self.context.plan.profiles),
            'eta_s': f'{progress.eta():.1f}',
            'code': '' if result is None else str(result['code']),
            'result': '' if result is None else text(result),
        }

    @staticmethod
    def nothing() -> dict[str, str]:
        """Return the values of ``scan_status`` before the first scan."""
        return {**dict.fromkeys(_KEYS, ''), 'stage': str(Stage.IDLE)}

    def _answer(self, outcome: Outcome) -> dict[str, Any]:
        answer = {
            'code': outcome.code,
            'scan_id': self.scan_id,
            'folder': str(self.folder),
            'files': {
                path.name: str(path)
                for path in sorted(self.folder.iterdir())
                if path.is_file() and not path.name.startswith('.')
            },
            'parameters': self.context.request.as_dict(),
            'counts': self._counts(outcome),
            'seconds': {name: round(s, 3) for name, s in outcome.seconds.items()},
            'registration': _without_code(outcome.registration),
            'mesh': _without_code(outcome.mesh),
        }
        if outcome.detail:
            answer['detail'] = outcome.detail
        if self.tools.picture_error:
            answer['picture_error'] = self.tools.picture_error
        return answer

    def _counts(self, outcome: Outcome) -> dict[str, Any]:
        heads = self.link.heads
        return {
            'views': len({head.view for head in heads.values()}),
            'profiles': len(heads),
            'profiles_planned': self.context.plan.profiles,
            'points': sum(head.points for head in heads.values()),
            'messages': self.tools.bag.get('messages'),
            'dropped': self.tools.bag.get('dropped'),
        }

    def _save(self, outcome: Outcome | None = None) -> None:
        document: dict[str, Any] = {
            'scan_id': self.scan_id,
            'stage': str(self.machine.stage),
            'code': '' if outcome is None else outcome.code,
            'detail': '' if outcome is None else outcome.detail,
            'request': self.context.request.as_dict(),
            'views_done': self._progress.views_done,
            'views_total': self.context.plan.views,
            'profiles_done': self._progress.profiles_done,
            'profiles_total': self.context.plan.profiles,
        }
        record.save_job(self.folder, document)


def _without_code(answer: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in answer.items() if key != 'code'}
