# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One scan from its acceptance to its response: files, catalogue rows, status, result."""

from collections.abc import Mapping
from dataclasses import asdict
from dataclasses import dataclass
from dataclasses import field
from dataclasses import replace
from pathlib import Path
import shutil
import time
from typing import Any

from rclpy.task import Future

from ivfmc_ros.acceptance.state import copy_record
from ivfmc_ros.cell.camera_file import save_camera
from ivfmc_ros.cell.cell_file import CellDraft
from ivfmc_ros.cell.cell_file import save_draft
from ivfmc_ros.errors import ScanError
from ivfmc_ros.nodes.framework.json_response import to_json
from ivfmc_ros.nodes.scanning.cell_link import CellLink
from ivfmc_ros.nodes.scanning.graph_tools import GraphTools
from ivfmc_ros.nodes.scanning.scan_context import ScanContext
from ivfmc_ros.scan import scan_folder
from ivfmc_ros.scan.job import Outcome
from ivfmc_ros.scan.job import run_job
from ivfmc_ros.scan.progress import ScanProgress
from ivfmc_ros.scan.recipe_verdict import INSPECTION
from ivfmc_ros.scan.report import PENDING
from ivfmc_ros.scan.report import REPORT_PAGE
from ivfmc_ros.scan.resume import CAN_RESUME
from ivfmc_ros.scan.resume import COURSE
from ivfmc_ros.scan.resume import Course
from ivfmc_ros.scan.resume import RESUMABLE
from ivfmc_ros.scan.state_machine import FINAL_STAGES
from ivfmc_ros.scan.state_machine import Stage
from ivfmc_ros.scan.state_machine import StateMachine
from ivfmc_ros.scan.stored_recipe import store_recipe
from ivfmc_ros.scan.temperature import load_temperature
from ivfmc_ros.storage.catalogue.calibrations import add_calibration
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.catalogue.catalogue_writer import CatalogueWriter
from ivfmc_ros.storage.catalogue.inspections import add_inspection
from ivfmc_ros.storage.messages.camera_info import to_camera

# Time-out of a locked catalogue, seconds: short, because it blocks the node.
_CATALOGUE_TIMEOUT_S = 2.0

# The keys of scan_status, part of the public interface.
_KEYS = (
    'scan_id',
    'stage',
    'views_done',
    'views_total',
    'profiles_done',
    'profiles_total',
    'eta_s',
    'code',
    'verdict',
    'result',
    'report',
    'report_error',
)


@dataclass(kw_only=True)
class RunningScan:
    """
    A scan that was accepted.

    ended : future of the response
    result : the response, None while the scan runs
    report, report_error : path of the rendered report, or why there is none; '' before
    """

    context: ScanContext
    machine: StateMachine
    tools: GraphTools
    link: CellLink
    ended: Future
    result: Mapping[str, Any] | None = None
    report: str = ''
    report_error: str = ''
    _writer: CatalogueWriter = field(init=False)
    _progress: ScanProgress = field(init=False)
    _course: Course = field(init=False)
    _has_scanned: bool = False

    def __post_init__(self) -> None:
        context = self.context
        self._progress = ScanProgress(context.plan, context.motion, time.monotonic)
        self._course = Course(
            plan=context.plan,
            motion=context.motion,
            limits=context.limits,
            tolerance=context.tolerance,
            patience=context.patience,
            home=context.home,
        )
        if context.resumed is not None:
            self._course = context.resumed.course
            self._progress.set_recorded_profiles(context.resumed.first_profile)
        self.tools.on_begin = self._save_begun

    @property
    def scan_id(self) -> str:
        """Id of the scan, the name of its folder."""
        return self.context.scan_id

    @property
    def folder(self) -> Path:
        """Folder of all files of the scan."""
        return self.context.folder

    def save_inputs(self, draft: CellDraft, parameters: Mapping[str, Any]) -> None:
        """
        Write cell.yaml with the record of its test, the recipe, parameters and catalogue row.

        :raises ScanError: one of them cannot be written; the folder is removed again
        """
        try:
            save_draft(self.folder / 'cell.yaml', draft)
            copy_record(self.context.cell, self.folder)
            if (recipe := self.context.recipe) is not None:
                store_recipe(recipe, Path(parameters['recipe_root']), self.folder)
            scan_folder.save_parameters(self.folder, parameters)
            self._save()
            catalogue = Catalogue(self.folder.parent, create=True, timeout_s=_CATALOGUE_TIMEOUT_S)
            request = self.context.request
            catalogue.add_scan(
                self.scan_id, request.part, request.recipe, str(Stage.IDLE), request.as_dict()
            )
        except ScanError:
            shutil.rmtree(self.folder, ignore_errors=True)
            raise
        self._writer = CatalogueWriter(catalogue)
        scan_id, folder = self.scan_id, self.folder
        self._writer.add(lambda catalogue: add_calibration(catalogue, scan_id, folder))

    def reopen(self) -> None:
        """
        Mark an interrupted scan as running again.

        :raises ScanError: its job file or the catalogue cannot be written
        """
        catalogue = Catalogue(self.folder.parent, create=True, timeout_s=_CATALOGUE_TIMEOUT_S)
        self._save()
        self._writer = CatalogueWriter(catalogue)
        self._save_stage()

    def _save_begun(self) -> None:
        """Store which sweeps have begun, and by which zero of the table."""
        self._progress.set_begun(self.tools.begun)
        self._course = replace(
            self._course,
            begun=tuple(self.tools.begun),
            zero=self.link.diagnostics.zero or '',
        )
        self._save()

    async def run(self) -> dict[str, Any]:
        """Run the scan to its end and return the response."""
        # locked, so that another orchestrator does not mark the scan as interrupted
        with scan_folder.lock_scan(self.folder):
            return await self._run()

    async def _run(self) -> dict[str, Any]:
        context, resumed = self.context, self.context.resumed
        begun = resumed.planned if resumed is not None else ()
        outcome = await run_job(self.machine, context.plan, context.motion, self.tools, begun)
        answer = self._answer(outcome)
        self._save(outcome)
        self._save_stage(outcome.code)
        if outcome.code == 'OK':
            scan_id, result = self.scan_id, dict(answer)
            self._writer.add(lambda catalogue: catalogue.add_result(scan_id, scan_id, result))
        inspection = self.folder / INSPECTION
        if outcome.inspection and inspection.is_file():
            self._writer.add(lambda catalogue: add_inspection(catalogue, self.scan_id, inspection))
        await self.tools.in_thread(self._writer.close)
        error = self._writer.error or self.tools.bag.get('catalogue_error')
        if error:
            answer['catalogue_error'] = error
        self.result = answer
        return dict(answer)

    def _save_stage(self, code: str = '') -> None:
        """Write the stage to the catalogue, in the background; an error does not end the scan."""
        stage = str(self.machine.stage)
        self._writer.add(lambda catalogue: catalogue.set_stage(self.scan_id, stage, code))

    def on_stage_change(self) -> None:
        """Write the new stage to disk and catalogue, and camera.yaml when scanning starts."""
        stage = self.machine.stage
        self._progress.set_stage(stage)
        self._has_scanned |= stage is Stage.SCANNING
        if stage is Stage.SCANNING and not (self.folder / 'camera.yaml').exists():
            save_camera(self.folder / 'camera.yaml', to_camera(self.tools.camera_info))
        self._save()
        self._save_stage()

    def update_progress(self) -> None:
        """Update the counts of views and profiles."""
        if self.machine.stage in (Stage.IDLE, Stage.PREPARING):
            # ``recorded`` still belongs to the previous scan
            return
        if self.link.recorded is not None:
            self._progress.set_recorded_profiles(self.link.recorded + 1)
        planned = self.context.plan.views
        views = [head.view for head in self.link.headers.values() if head.view < planned]
        if views:
            self._progress.set_current_view(max(views))

    def mark_interrupted(self) -> None:
        """Mark the scan as interrupted, because this process ends."""
        try:
            scan_folder.mark_scan_interrupted(self.folder)
        except ScanError:
            # marked at the next start
            return
        failed = str(Stage.FAILED)
        self._writer.add(
            lambda catalogue: catalogue.set_stage(self.scan_id, failed, 'INTERRUPTED')
        )
        self._writer.close()

    def status(self) -> dict[str, str]:
        """Return the key-value pairs of ``scan_status``."""
        progress = self._progress
        result = self.result
        stage = self.machine.stage
        if result is not None and stage not in FINAL_STAGES:
            # the orchestrator ends before the scan
            stage = Stage.FAILED
        return {
            'scan_id': self.scan_id,
            'stage': str(stage),
            'views_done': str(progress.views_done),
            'views_total': str(self.context.plan.views),
            'profiles_done': str(progress.profiles_done),
            'profiles_total': str(progress.profiles_total),
            'eta_s': f'{progress.eta_s():.1f}',
            'code': '' if result is None else str(result['code']),
            'verdict': '' if result is None else str(result.get('verdict', '')),
            'result': '' if result is None else to_json(result),
            'report': self.report,
            'report_error': self.report_error,
        }

    @staticmethod
    def idle_status() -> dict[str, str]:
        """Return the key-value pairs of ``scan_status`` before the first scan."""
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
            'completeness': dict(outcome.completeness),
            'resumed': self.context.resumed is not None,
            PENDING: self.tools.has_figures,
        }
        if outcome.detail:
            answer['detail'] = outcome.detail
        # as the inspection has it: readings may have come since
        if (temperature := load_temperature(self.folder)) is not None:
            answer['temperature'] = asdict(temperature)
        if outcome.inspection:
            answer['verdict'] = outcome.inspection['verdict']
            answer['inspection'] = dict(outcome.inspection)
        return answer

    def report_ended(self, error: str) -> None:
        """Note that the report is rendered; ``error`` : why it could not be, or ''."""
        self.report = '' if error else str(self.folder / REPORT_PAGE)
        self.report_error = error

    def _counts(self, outcome: Outcome) -> dict[str, Any]:
        headers = self.link.headers
        return {
            'views': len({header.view for header in headers.values()}),
            'profiles': len(headers),
            'profiles_planned': self.context.plan.profiles,
            'points': sum(header.points for header in headers.values()),
            'messages': self.tools.bag.get('messages'),
            'dropped': self.tools.bag.get('dropped'),
        }

    def _save(self, outcome: Outcome | None = None) -> None:
        document: dict[str, Any] = {
            'scan_id': self.scan_id,
            'cell': self.context.cell_name,
            'stage': str(self.machine.stage),
            'code': '' if outcome is None else outcome.code,
            'detail': '' if outcome is None else outcome.detail,
            'request': self.context.request.as_dict(),
            'views_done': self._progress.views_done,
            'views_total': self.context.plan.views,
            'profiles_done': self._progress.profiles_done,
            'profiles_total': self._progress.profiles_total,
            PENDING: outcome is not None and self.tools.has_figures,
            CAN_RESUME: outcome is None or self._can_resume(outcome.code),
            COURSE: self._course.as_dict(),
        }
        scan_folder.save_job(self.folder, document)

    def _can_resume(self, code: str) -> bool:
        """Return whether a scan that ended with this code can go on."""
        is_as_before = self.context.resumed is not None and not self._has_scanned
        return code in RESUMABLE or is_as_before


def interrupted_status(folder: Path) -> dict[str, str]:
    """
    Return the key-value pairs of ``scan_status`` of a scan that was marked as interrupted.

    :raises FileError: its job file cannot be read
    """
    job = scan_folder.load_job(folder)
    result = {
        'code': job['code'],
        'detail': job['detail'],
        'scan_id': folder.name,
        'folder': str(folder),
    }
    counts = ('views_done', 'views_total', 'profiles_done', 'profiles_total')
    return {
        **dict.fromkeys(_KEYS, ''),
        'scan_id': folder.name,
        'stage': str(job['stage']),
        **{key: str(job.get(key, '')) for key in counts},
        'eta_s': '0.0',
        'code': str(job['code']),
        'result': to_json(result),
    }


def _without_code(answer: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in answer.items() if key != 'code'}
