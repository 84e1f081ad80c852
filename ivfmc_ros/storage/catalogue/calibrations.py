# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Stores the calibration with which a scan was taken, and the result of its acceptance test."""

from collections.abc import Mapping
from dataclasses import dataclass
import hashlib
import json
from pathlib import Path
from typing import Any

import sqlalchemy as sql

from ivfmc_ros import files
from ivfmc_ros.acceptance.state import record_path
from ivfmc_ros.cell.calibration_id import calibration_id
from ivfmc_ros.cell.cell_file import CellDraft
from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.catalogue.schema import CALIBRATIONS
from ivfmc_ros.storage.catalogue.schema import CERTIFICATES
from ivfmc_ros.storage.catalogue.schema import SCANS

_CELL_FILE = 'cell.yaml'


@dataclass(frozen=True, kw_only=True)
class CertificateRow:
    """
    An acceptance test of a calibration.

    created : ISO 8601
    verdict : pass, fail, ...
    """

    created: str
    verdict: str


def add_calibration(catalogue: Catalogue, scan_id: str, folder: Path) -> bool:
    """
    Add cell.yaml in the folder of a scan, and the acceptance test of that calibration, if any.

    The row of the scan refers to the calibration; equal files of a cell have one row.

    :returns: False where there is no cell.yaml that can be read
    :raises CatalogueError: the scan does not exist, or the database cannot be written
    """
    try:
        data = files.read_bytes(folder / _CELL_FILE)
        draft = load_draft(folder / _CELL_FILE)
    except ScanError:
        # a scan is found without its calibration too
        return False
    scan = catalogue.scan(scan_id).key
    with catalogue.database.write() as connection:
        # the row of the scan is locked: two processes must not add one certificate each
        cell = connection.execute(
            sql.select(SCANS.c.cell).where(SCANS.c.id == scan).with_for_update()
        ).scalar_one()
        key = _calibration(catalogue, connection, cell, data, draft.created or '')
        connection.execute(sql.update(SCANS).where(SCANS.c.id == scan).values(calibration=key))
        if record := _record(folder / _CELL_FILE, draft):
            _add_certificate(connection, key, record)
    return True


def _calibration(
    catalogue: Catalogue, connection: sql.engine.Connection, cell: int, data: bytes, created: str
) -> int:
    """Return the key of a calibration, which is added where it is new."""
    digest = hashlib.sha256(data).hexdigest()
    insert = catalogue.database.insert(CALIBRATIONS).values(
        cell=cell, sha256=digest, created=created, document=data.decode('utf-8', 'replace')
    )
    connection.execute(insert.on_conflict_do_nothing(index_elements=['cell', 'sha256']))
    query = sql.select(CALIBRATIONS.c.id).where(
        CALIBRATIONS.c.cell == cell, CALIBRATIONS.c.sha256 == digest
    )
    return int(connection.execute(query).scalar_one())


def _add_certificate(
    connection: sql.engine.Connection, calibration: int, record: Mapping[str, Any]
) -> None:
    created = str(record['created'])
    known = sql.select(CERTIFICATES.c.id).where(
        CERTIFICATES.c.calibration == calibration, CERTIFICATES.c.created == created
    )
    if connection.execute(known).first() is None:
        insert = sql.insert(CERTIFICATES).values(
            calibration=calibration,
            created=created,
            verdict=str(record['verdict']),
            document=json.dumps(record),
        )
        connection.execute(insert)


def certificates(catalogue: Catalogue, scan_id: str) -> list[CertificateRow]:
    """Return the acceptance tests of the calibration of a scan, the oldest first."""
    key = catalogue.scan(scan_id).key
    query = (
        sql.select(CERTIFICATES.c.created, CERTIFICATES.c.verdict)
        .join(SCANS, SCANS.c.calibration == CERTIFICATES.c.calibration)
        .where(SCANS.c.id == key)
        .order_by(CERTIFICATES.c.created)
    )
    with catalogue.database.read() as connection:
        return [CertificateRow(**row) for row in connection.execute(query).mappings()]


def _record(cell_file: Path, draft: CellDraft) -> dict[str, Any]:
    """Return the record of the acceptance test of a calibration; an empty one without it."""
    if draft.turntable is None:
        return {}
    try:
        document = json.loads(files.read_bytes(record_path(cell_file)))
    except (FileError, ValueError):
        return {}
    if not isinstance(document, dict) or not {'created', 'verdict'} <= document.keys():
        return {}
    identity = calibration_id(draft.turntable, draft.lasers)
    return document if document.get('calibration') == identity else {}
