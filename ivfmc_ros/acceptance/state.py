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


def copy_record(cell_file: Path, folder: Path) -> None:
    """
    Copy the record of the last test of a cell, if there is one, beside a copy of its cell.yaml.

    folder : with ``cell.yaml``, such as that of a scan
    :raises FileError: the record cannot be read, or its copy not be written
    """
    source = record_path(cell_file)
    if source.exists():
        text = files.read_bytes(source).decode(errors='replace')
        files.write_text(record_path(folder / 'cell.yaml'), text)


def certificate_text(path: Path, calibration: str) -> str:
    """
    Return date, artifact and result of the last test of a calibration, for a title block.

    path : of the record, from ``record_path``
    calibration : ``calibration_id`` of the cell that measured
    :returns: where there is none, or it is of another calibration, a text that says so; '' for a
        damaged record
    """
    if not path.exists():
        return 'none: the cell was never checked'
    try:
        record = _read(path)
    except FileError:
        return ''
    if record['calibration'] != calibration:
        return 'none: the last check was of another calibration'
    day = datetime.fromisoformat(record['created']).date().isoformat()
    temperature = record.get('temperature_c')
    parts = (
        f'{record["verdict"]} on {day}',
        str(record.get('artifact', '')),
        '' if temperature is None else f'at {temperature:g} °C',
    )
    return ', '.join(filter(None, parts))


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
