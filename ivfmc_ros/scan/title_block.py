# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The title block of a scan's report: what was measured, when, by which cell and settings."""

from collections.abc import Mapping
import hashlib
from pathlib import Path
from typing import Any

from ivfmc_ros import __version__
from ivfmc_ros.acceptance.state import certificate_text
from ivfmc_ros.acceptance.state import record_path
from ivfmc_ros.cell.calibration_id import calibration_id
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.cell_file import CellDraft
from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.cell.scale import doubt_text
from ivfmc_ros.cell.scale import scale_u
from ivfmc_ros.errors import ScanError
from ivfmc_ros.scan.scan_folder import load_job
from ivfmc_ros.scan.scan_folder import PARAMETER_FILE

_HASH_DIGITS = 12


def title_block(folder: Path) -> dict[str, str]:
    """
    Return the texts of the title block of a scan folder, by name.

    What a file that is missing or damaged would say is left out; the operator signs on paper.
    """
    texts = {
        **(scan_texts(folder) or {'scan': folder.name, 'time (UTC)': _time_of(folder.name)}),
        **_cell(folder / 'cell.yaml'),
        'settings (SHA-256)': _digest(folder / PARAMETER_FILE),
        'software': f'ivfmc_ros {__version__}',
    }
    return {**{name: text for name, text in texts.items() if text}, 'operator': ''}


def scan_texts(folder: Path) -> dict[str, str]:
    """Return what was scanned, when and by which cell; empty for a folder that is no scan."""
    job = _job(folder)
    if not job:
        return {}
    request = job.get('request', {})
    return {
        'part': str(request.get('part', '')),
        'recipe': str(request.get('recipe', '')),
        'scan': folder.name,
        'time (UTC)': _time_of(folder.name),
        'cell': str(job.get('cell', '')),
    }


def without_folder(value: Any, folder: Path) -> Any:
    """Return figures with the paths of files in a folder as names: a report is read elsewhere."""
    if isinstance(value, Mapping):
        return {key: without_folder(item, folder) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [without_folder(item, folder) for item in value]
    if isinstance(value, str):
        if value.startswith('/') and (folder / Path(value).name).exists():
            # the folder may have been moved since
            return Path(value).name
        return value.replace(f'{folder}/', '').replace(str(folder), folder.name)
    return value


def _job(folder: Path) -> Mapping[str, Any]:
    try:
        return load_job(folder)
    except ScanError:
        return {}


def _time_of(scan_id: str) -> str:
    """Return the time with which the name of a scan begins, such as 20261127T145851Z."""
    stamp = scan_id.partition('_')[0]
    if len(stamp) != 16 or stamp[8] != 'T' or not stamp.endswith('Z'):
        return ''
    day, clock = stamp[:8], stamp[9:15]
    return f'{day[:4]}-{day[4:6]}-{day[6:]} {clock[:2]}:{clock[2:4]}:{clock[4:]}'


def _cell(path: Path) -> dict[str, str]:
    try:
        return cell_texts(load_draft(path), path)
    except ScanError:
        return {}


def source_texts(folder: Path, cell_path: Path | None = None) -> dict[str, str]:
    """
    Return the texts of a title block that the source of a reconstruction or inspection gives.

    folder : of the bag or mesh, which may be that of a scan
    cell_path : cell.yaml to use instead of the one in the folder
    """
    texts = {**scan_texts(folder), **_cell(cell_path or folder / 'cell.yaml')}
    return {name: text for name, text in texts.items() if text}


def cell_texts(cell: CellDraft | Cell, path: Path | None = None) -> dict[str, str]:
    """
    Return the texts of a title block that a cell gives; '' for what it does not state.

    path : of its cell.yaml, beside which the record of its acceptance test is; None if not known
    """
    temperature = cell.notes.get('temperature_c')
    identity = calibration_id(cell.turntable, cell.lasers) if cell.turntable else ''
    created = (cell.created if isinstance(cell, CellDraft) else None) or ''
    return {
        'lasers': ', '.join(laser.name for laser in cell.lasers),
        'calibration': ', '.join(filter(None, (created, identity and f'id {identity}'))),
        'certificate': certificate_text(record_path(path), identity) if path and identity else '',
        'calibration uncertainty': _covariance(cell),
        'scale from': _scale(cell),
        'calibrated at': '' if temperature is None else f'{temperature:g} °C',
    }


def _scale(cell: CellDraft | Cell) -> str:
    """Return the known length that gave the scale, and its uncertainty."""
    board = cell.notes.get('board', '')
    if isinstance(board, Mapping):
        # of the steps of a calibration, that of the table decides
        named = board.get('turntable_scale') or board.get('scale')
        board = named or ', '.join(f'{key} {value}' for key, value in board.items())
    u = scale_u(cell.notes, cell.covariance)
    stated = f'relative u = {u:.2g}' if u else ''
    return ', '.join(filter(None, (str(board), stated, doubt_text(cell.notes))))


def _covariance(cell: CellDraft | Cell) -> str:
    if cell.covariance is not None:
        return 'joint covariance of all parameters'
    has_own = any(laser.covariance is not None for laser in cell.lasers)
    return 'covariance of each laser plane' if has_own else 'not known'


def digest(data: bytes) -> str:
    """Return the first digits of a SHA-256, enough to tell settings apart."""
    return hashlib.sha256(data).hexdigest()[:_HASH_DIGITS]


def _digest(path: Path) -> str:
    try:
        return digest(path.read_bytes())
    except OSError:
        return ''
