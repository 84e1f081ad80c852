# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Stores the verdict and the measured features of an inspection's ``report.json``."""

from collections.abc import Mapping
import hashlib
import json
import math
from pathlib import Path
from typing import Any

import sqlalchemy as sql

from ivfmc_ros import files
from ivfmc_ros.errors import FileError
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.catalogue.rows import FeatureRow
from ivfmc_ros.storage.catalogue.schema import FEATURES
from ivfmc_ros.storage.catalogue.schema import SCANS
from ivfmc_ros.storage.catalogue.schema import VERDICTS


def add_inspection(catalogue: Catalogue, scan_id: str, report: Path) -> bool:
    """
    Add the results of an inspection to a scan; a report that is there already is not added again.

    report : report.json of ``ivfmc inspect``
    :returns: False where it is there already
    :raises FileError: the file is not the report of an inspection
    :raises CatalogueError: the scan does not exist
    """
    data = files.read_bytes(report)
    document = _document(report, data)
    digest = hashlib.sha256(data).hexdigest()
    key = catalogue.scan(scan_id).key
    with catalogue.database.write() as connection:
        # the row of the scan is locked: two reports must not get one number
        connection.execute(sql.select(SCANS.c.id).where(SCANS.c.id == key).with_for_update()).one()
        known = connection.execute(
            sql.select(VERDICTS.c.number, VERDICTS.c.sha256).where(VERDICTS.c.scan == key)
        ).all()
        if any(row.sha256 == digest for row in known):
            return False
        number = max((row.number for row in known), default=-1) + 1
        verdict = str(document['verdict'])
        connection.execute(
            sql.insert(VERDICTS).values(
                scan=key,
                number=number,
                created=str(document.get('created', '')),
                verdict=verdict,
                nominal=str(document.get('nominal', '')),
                sha256=digest,
            )
        )
        rows = [
            {'scan': key, 'number': number, **vars(row)} for row in features_of(document, report)
        ]
        if rows:
            connection.execute(sql.insert(FEATURES), rows)
        connection.execute(sql.update(SCANS).where(SCANS.c.id == key).values(verdict=verdict))
    return True


def features_of(document: Mapping[str, Any], report: Path) -> list[FeatureRow]:
    """
    Return the measured values of a report.

    :raises FileError: an entry lacks a key
    """
    rows = {}
    for index, item in enumerate(document.get('characteristics', [])):
        try:
            row = FeatureRow(
                feature=str(item['feature']),
                characteristic=str(item['characteristic']),
                nominal=_number(item['nominal_m']),
                measured=_number(item['measured_m']),
                uncertainty=_number(item['U_m']),
                tolerance=_number(item['tolerance_m']),
                verdict=str(item['verdict']),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise FileError(
                f'{report}: characteristics[{index}]: is not valid: {error}'
            ) from error
        rows[row.feature, row.characteristic] = row
    return list(rows.values())


def _number(value: object) -> float | None:
    if value is None:
        return None
    number = float(str(value))
    return number if math.isfinite(number) else None


def _document(report: Path, data: bytes) -> Mapping[str, Any]:
    try:
        document = json.loads(data)
    except ValueError as error:
        raise FileError(f'{report}: is not JSON: {error}') from error
    if not is_inspection(document):
        raise FileError(f'{report}: is not the report of an inspection')
    return document if isinstance(document, dict) else {}


def is_inspection(document: object) -> bool:
    """Tell whether a JSON document is the report of an inspection."""
    return isinstance(document, dict) and 'verdict' in document and 'characteristics' in document
