# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether the last acceptance test of a cell, kept beside its ``cell.yaml``, still counts."""

from dataclasses import dataclass
from datetime import datetime
from datetime import timedelta
from datetime import UTC
import json
from pathlib import Path
from typing import Any

from ivfmc_ros import files
from ivfmc_ros.errors import FileError

NEVER, CURRENT, TOO_OLD, FAILED, OTHER_CALIBRATION = (
    'never',
    'current',
    'too old',
    'failed',
    'other calibration',
)


@dataclass(frozen=True, kw_only=True)
class CheckState:
    """
    Whether the last acceptance test still speaks for a cell.

    state : never, current, too old, failed or other calibration
    detail : one sentence for the operator
    """

    state: str
    detail: str

    @property
    def is_current(self) -> bool:
        """Whether the cell may measure without a warning."""
        return self.state == CURRENT


def record_path(cell_file: Path) -> Path:
    """Return where the last test of a cell is: ``cell.check.json`` beside ``cell.yaml``."""
    return cell_file.with_name(f'{cell_file.stem}.check.json')


def check_state(
    path: Path, calibration: str, max_age: timedelta, now: datetime | None = None
) -> CheckState:
    """
    Return whether the last test of a cell still speaks for it.

    path : of the record, from ``record_path``
    calibration : ``calibration_id`` of the cell that is to measure
    :raises FileError: the record cannot be read
    """
    if not path.exists():
        return CheckState(
            state=NEVER, detail=f'{path}: the cell was never checked; run ivfmc calibrate check'
        )
    record = _read(path)
    created, verdict = datetime.fromisoformat(record['created']), record['verdict']
    checked = record['calibration'] or 'unknown'
    if checked != calibration:
        return CheckState(
            state=OTHER_CALIBRATION,
            detail=f'{path}: the last check was of calibration {checked}, the cell has '
            f'{calibration}; run ivfmc calibrate check again',
        )
    if verdict != 'pass':
        return CheckState(
            state=FAILED,
            detail=f'{path}: the last check ended with {verdict}; calibrate the cell again',
        )
    age = (now or datetime.now(UTC)) - created
    if age > max_age:
        return CheckState(
            state=TOO_OLD,
            detail=f'{path}: the last check is {age.days} days old, more than {max_age.days} are '
            'not allowed; run ivfmc calibrate check again',
        )
    return CheckState(state=CURRENT, detail=f'{path}: checked {age.days} days ago')


def _read(path: Path) -> dict[str, Any]:
    try:
        record = json.loads(files.read_bytes(path))
        datetime.fromisoformat(record['created'])
        if not {'calibration', 'verdict'} <= set(record):
            raise KeyError('verdict')
    except (ValueError, KeyError, TypeError) as error:
        raise FileError(f'{path}: is no record of a check ({error}); delete it') from error
    return dict(record)
