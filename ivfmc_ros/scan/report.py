# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writes the report of a finished scan: ``report.json``, ``mesh.png`` and ``report.html``."""

from collections.abc import Mapping
import json
from pathlib import Path
import subprocess
import sys
from typing import Any

from ivfmc_ros.errors import FileError
from ivfmc_ros.inspection.reports.json_report import write_report
from ivfmc_ros.scan.job import Outcome

REPORT = 'report.json'
MESH_IMAGE = 'mesh.png'

# Timeout of the rendering process, seconds; meshes of a million faces take about 20 s.
_RENDER_TIMEOUT_S = 120.0


def finish_scan(folder: Path, outcome: Outcome, document: Mapping[str, Any]) -> str:
    """
    Write the report and the images of a scan; blocks until they are on disk.

    document : further entries of ``report.json``, such as the recorder's counts
    :returns: why there are no images, '' where they were rendered; a scan whose mesh is written
        does not fail without images
    :raises FileError: the report cannot be written
    """
    figures = {
        **document,
        'code': outcome.code,
        'detail': outcome.detail,
        'registration': outcome.registration,
        'mesh': outcome.mesh,
        'completeness': outcome.completeness,
        'seconds': outcome.seconds,
    }
    error = ''
    try:
        render_in_process(folder, str(outcome.mesh.get('unit', 'mm')), figures)
    except FileError as failure:
        error = figures['picture_error'] = str(failure)
    write_report(folder / REPORT, figures)
    return error


def render_in_process(folder: Path, unit: str, figures: Mapping[str, Any]) -> None:
    """
    Render the images of a scan in a child process: rendering holds the GIL for seconds.

    unit : length unit of the mesh files: m, mm or inch
    :raises FileError: the process failed, or took longer than the timeout
    """
    command = [sys.executable, '-m', 'ivfmc_ros.scan.report_renderer', str(folder), unit]
    request = json.dumps(figures)
    try:
        answer = subprocess.run(
            command,
            input=request,
            capture_output=True,
            text=True,
            timeout=_RENDER_TIMEOUT_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise FileError(f'{folder / MESH_IMAGE}: could not be rendered: {error}') from error
    if answer.returncode:
        last = (answer.stderr.strip() or 'no reason given').splitlines()[-1]
        raise FileError(f'{folder / MESH_IMAGE}: could not be rendered: {last}')
