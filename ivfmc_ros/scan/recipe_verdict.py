# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The verdict on a scan by its recipe: a process that inspects the mesh, and its result in short.

The inspection takes seconds to minutes, and a scan can be cancelled while it runs.
"""

from collections.abc import Mapping
import json
from pathlib import Path
import subprocess
import sys
import tempfile
from typing import Any

from ivfmc_ros import files
from ivfmc_ros.errors import FileError
from ivfmc_ros.inspection.verdict import NOT_DECIDED

INSPECTION, INSPECTION_PAGE = 'inspection.json', 'inspection.html'
# What the answer of a scan repeats of a measured characteristic and of a surface; in meters.
_OF_CHARACTERISTIC = (
    'feature', 'characteristic', 'nominal_m', 'measured_m', 'U_m', 'tolerance_m', 'verdict',
)  # fmt: skip
_OF_SURFACE = ('name', 'worst_m', 'within', 'coverage', 'U_m', 'tolerance_m', 'verdict')


class InspectionProcess:
    """
    A process that judges the mesh in the folder of a scan.

    is_done : whether it has ended
    """

    def __init__(self, folder: Path, recipe: str) -> None:
        """
        Start it.

        recipe : name of the recipe that is stored in the folder
        :raises FileError: it cannot be started
        """
        self._folder, self._recipe = folder, recipe
        module = 'ivfmc_ros.scan.recipe_inspection'
        command = [sys.executable, '-m', module, str(folder), recipe]
        # not a pipe, which would be read at the end only; ``kill`` closes the file
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=self._errors,
            )
        except OSError as error:
            self._errors.close()
            raise FileError(f'{folder}: cannot be inspected: {error}') from error

    @property
    def is_done(self) -> bool:
        """Whether the process has ended."""
        return self._process.poll() is not None

    def result(self) -> dict[str, Any]:
        """Return the verdict of a process that has ended; without one nothing is decided."""
        code = self._process.wait()
        if code:
            self._errors.seek(0)
            text = self._errors.read().decode(errors='replace').strip()
            return undecided(self._recipe, (text or f'exit code {code}').splitlines()[-1])
        try:
            return _short(json.loads(files.read_bytes(self._folder / INSPECTION)))
        except (FileError, ValueError, KeyError, TypeError) as error:
            return undecided(self._recipe, f'{INSPECTION}: {error}')

    def kill(self) -> None:
        """End the process if it still runs, and release it."""
        self._process.kill()
        self._process.wait()
        self._errors.close()


def undecided(recipe: str, reason: str) -> dict[str, Any]:
    """Return the result of a mesh that could not be judged."""
    return {'verdict': NOT_DECIDED, 'recipe': recipe, 'reason': reason}


def _short(figures: Mapping[str, Any]) -> dict[str, Any]:
    rows = figures['characteristics']
    return {
        'verdict': figures['verdict'],
        'recipe': figures['recipe'],
        'file': INSPECTION,
        'notes': figures['notes'],
        'unseen': figures['unseen'],
        'missing': figures['missing'],
        'characteristics': [{key: row[key] for key in _OF_CHARACTERISTIC} for row in rows],
        'surface': [{key: row[key] for key in _OF_SURFACE} for row in figures['surface']],
    }
