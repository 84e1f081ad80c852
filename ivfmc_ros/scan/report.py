# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a finished scan says of itself: ``report.json`` and pictures to look at."""

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
PICTURE = 'mesh.png'

_PICTURE_S = 120.0


def finish_scan(folder: Path, outcome: Outcome, document: Mapping[str, Any]) -> str:
    """
    Write the report and the pictures of a scan; waits until they are on disk.

    Return why there are no pictures, which is no end of a scan whose mesh is written, or nothing.

    :raises FileError: the report cannot be written
    """
    figures = {
        **document,
        'code': outcome.code,
        'detail': outcome.detail,
        'registration': outcome.registration,
        'mesh': outcome.mesh,
        'seconds': outcome.seconds,
    }
    error = ''
    try:
        draw(folder, str(outcome.mesh.get('unit', 'mm')), figures)
    except FileError as refused:
        error = figures['picture_error'] = str(refused)
    write_report(folder / REPORT, figures)
    return error


def draw(folder: Path, unit: str, figures: Mapping[str, Any]) -> None:
    """
    Draw the mesh and write the page of a scan in a process, which may hold its interpreter's lock.

    unit : of the mesh files
    :raises FileError: it could not be drawn
    """
    command = [sys.executable, '-m', 'ivfmc_ros.scan.draw', str(folder), unit]
    given = json.dumps(figures)
    try:
        answer = subprocess.run(
            command, input=given, capture_output=True, text=True, timeout=_PICTURE_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise FileError(f'{folder / PICTURE}: could not be drawn: {error}') from error
    if answer.returncode:
        last = (answer.stderr.strip() or 'no reason given').splitlines()[-1]
        raise FileError(f'{folder / PICTURE}: could not be drawn: {last}')
