# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Deletion of scans: to a trash folder, from which they are restored until it is emptied."""

from datetime import datetime
from datetime import UTC
from pathlib import Path
import shutil

from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import StateError
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.catalogue.catalogue import folder_of_cell
from ivfmc_ros.storage.catalogue.rows import ScanRow
from ivfmc_ros.storage.catalogue.search import ScanFilter

# Folder below that of the scans; a name with a dot is no scan.
TRASH = '.trash'
# Stages in which a scan has ended.
_FINAL = ('DONE', 'FAILED', 'CANCELLED')


def delete_scan(catalogue: Catalogue, scan_id: str) -> Path:
    """
    Move a scan to the trash, and return the folder that it has there.

    :raises StateError: the scan is in the trash already, or runs
    :raises FileError: its folder cannot be moved
    """
    row = catalogue.scan(scan_id)
    if row.deleted:
        raise StateError(f'{scan_id}: is in the trash since {row.deleted}')
    if row.stage not in _FINAL:
        raise StateError(f'{scan_id}: is in stage {row.stage}; cancel it first')
    root = folder_of_cell(catalogue.root, row.cell)
    target = root / TRASH / row.folder.name
    _move(row.folder, target)
    now = datetime.now(UTC).isoformat(timespec='milliseconds').replace('+00:00', 'Z')
    catalogue.update_scan(_name(row), deleted=now, folder=f'{TRASH}/{row.folder.name}')
    return target


def restore_scan(catalogue: Catalogue, scan_id: str) -> Path:
    """
    Move a scan from the trash to its place, and return its folder.

    :raises StateError: the scan is not in the trash
    :raises FileError: its folder cannot be moved
    """
    row = catalogue.scan(scan_id)
    if not row.deleted:
        raise StateError(f'{scan_id}: is not in the trash')
    target = folder_of_cell(catalogue.root, row.cell) / row.folder.name
    _move(row.folder, target)
    catalogue.update_scan(_name(row), deleted='', folder=row.folder.name)
    return target


def empty_trash(catalogue: Catalogue) -> list[str]:
    """
    Delete the scans in the trash for good, and return their ids.

    :raises FileError: a folder cannot be deleted
    """
    emptied = []
    for found in catalogue.find(ScanFilter(deleted=True)):
        row = catalogue.scan(f'{found.cell}/{found.scan_id}')
        try:
            if row.folder.exists():
                shutil.rmtree(row.folder)
        except OSError as error:
            reason = error.strerror or error
            raise FileError(f'{row.folder}: cannot be deleted: {reason}') from error
        with catalogue.database.write() as connection:
            catalogue.remove_rows(connection, row.key)
        emptied.append(row.scan_id)
    return emptied


def _name(row: ScanRow) -> str:
    return f'{row.cell}/{row.scan_id}'


def _move(source: Path, target: Path) -> None:
    """Move a folder; one that is gone, because its files were removed by hand, is left out."""
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.exists():
            raise FileError(f'{target}: exists already and is not overwritten')
        if source.exists():
            source.rename(target)
    except OSError as error:
        raise FileError(f'{source}: cannot be moved: {error.strerror or error}') from error
