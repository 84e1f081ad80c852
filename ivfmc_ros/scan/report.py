# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The report of a finished scan: ``report.json`` at once, ``mesh.png`` and ``report.html`` later.

The images take seconds and no caller waits for them: a child process renders them after the
answer of the scan, while the next scan may run.
"""

from collections.abc import Callable
from collections.abc import Mapping
from pathlib import Path
import subprocess
import sys
import threading
from typing import Any

from ivfmc_ros.errors import CancelledError
from ivfmc_ros.errors import FileError
from ivfmc_ros.inspection.reports.json_report import write_report
from ivfmc_ros.scan import scan_folder
from ivfmc_ros.scan.job import Outcome

REPORT = 'report.json'
REPORT_PAGE = 'report.html'
MESH_IMAGE = 'mesh.png'
# Key of job.json: true until the images and the page were rendered, or could not be.
PENDING = 'report_pending'

# Seconds for a mesh of millions of faces on a busy computer.
_RENDER_TIMEOUT_S = 600.0


def write_figures(folder: Path, outcome: Outcome, document: Mapping[str, Any]) -> None:
    """
    Write ``report.json``, with the figures of a scan.

    document : further entries, such as the recorder's counts
    :raises FileError: it cannot be written
    """
    figures = {
        **document,
        'code': outcome.code,
        'detail': outcome.detail,
        'registration': outcome.registration,
        'mesh': outcome.mesh,
        **({'inspection': outcome.inspection} if outcome.inspection else {}),
        'completeness': outcome.completeness,
        'seconds': outcome.seconds,
    }
    write_report(folder / REPORT, figures)


def pending_reports(root: Path) -> list[Path]:
    """Return the folders of ended scans whose report was not rendered when its process ended."""
    if not root.is_dir():
        return []
    found = []
    for folder in sorted(root.iterdir()):
        try:
            if scan_folder.load_job(folder).get(PENDING) is True:
                found.append(folder)
        except FileError:
            # no scan, or one of another program
            continue
    return found


class ReportRenderer:
    """
    Renders the reports of scans in child processes: rendering holds the GIL for seconds.

    ``render`` is for one thread, ``close`` for any.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[str] | None = None
        self._closed = False

    def render(self, folder: Path) -> str:
        """
        Render ``mesh.png`` and ``report.html`` of a scan folder, and note the end in job.json.

        :returns: why there are no images, '' where they were rendered; a scan whose mesh is
            written does not fail without images
        :raises CancelledError: ``close`` was called
        """
        error = ''
        try:
            render_in_process(folder, self._start)
        except FileError as failure:
            if self._closed:
                raise CancelledError('the report is rendered at the next start') from failure
            error = str(failure)
        try:
            job = {**scan_folder.load_job(folder), PENDING: False}
            scan_folder.save_job(folder, {**job, 'picture_error': error})
        except FileError as failure:
            # such as a scan that was deleted in the meantime
            error = error or str(failure)
        return error

    def close(self) -> None:
        """Kill the process that renders."""
        with self._lock:
            self._closed = True
            if self._process is not None:
                self._process.kill()

    def _start(self, command: list[str]) -> 'subprocess.Popen[str]':
        with self._lock:
            if self._closed:
                raise FileError('the renderer is closed')
            self._process = _start(command)
            return self._process


def _start(command: list[str]) -> 'subprocess.Popen[str]':
    return subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )


def render_in_process(
    folder: Path, start: Callable[[list[str]], 'subprocess.Popen[str]'] = _start
) -> None:
    """
    Render the images of a scan, whose ``report.json`` is written, in a child process.

    start : starts a command with a pipe for its stderr
    :raises FileError: the process failed, or took longer than the timeout
    """
    command = [sys.executable, '-m', 'ivfmc_ros.scan.report_renderer', str(folder)]
    try:
        process = start(command)
        try:
            _, text = process.communicate(timeout=_RENDER_TIMEOUT_S)
        finally:
            process.kill()
            process.wait()
    except (OSError, subprocess.TimeoutExpired) as error:
        raise FileError(f'{folder / MESH_IMAGE}: could not be rendered: {error}') from error
    if process.returncode:
        last = (text.strip() or 'no reason given').splitlines()[-1]
        raise FileError(f'{folder / MESH_IMAGE}: could not be rendered: {last}')
