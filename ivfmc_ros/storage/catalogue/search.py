# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Finds scans by part, recipe, cell, date, code, verdict, calibration and measured feature."""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sql

from ivfmc_ros.storage.catalogue.rows import FeatureRow
from ivfmc_ros.storage.catalogue.rows import FoundScan
from ivfmc_ros.storage.catalogue.schema import CALIBRATIONS
from ivfmc_ros.storage.catalogue.schema import CELLS
from ivfmc_ros.storage.catalogue.schema import FEATURES
from ivfmc_ros.storage.catalogue.schema import PARTS
from ivfmc_ros.storage.catalogue.schema import RECIPES
from ivfmc_ros.storage.catalogue.schema import SCANS
from ivfmc_ros.storage.catalogue.schema import VERDICTS
from ivfmc_ros.storage.catalogue.schema import VIEWS

# Scans whose views are counted in one query: below the number of variables of SQLite.
_BLOCK = 500


@dataclass(frozen=True, kw_only=True)
class ScanFilter:
    """
    What a scan must have to be found; '' and None match every scan.

    since, until : ISO 8601 in UTC; ``until`` is excluded
    verdict : of the last inspection
    calibration : first digits of the SHA-256 of cell.yaml
    feature, characteristic : only scans whose last inspection measured them, such as 'hole 3' and
        'diameter'; each value is one row
    deleted : scans in the trash instead of the others
    newest : only so many scans, the newest; 0: all
    """

    part: str = ''
    recipe: str = ''
    cell: str = ''
    code: str = ''
    verdict: str = ''
    calibration: str = ''
    since: str = ''
    until: str = ''
    feature: str = ''
    characteristic: str = ''
    deleted: bool = False
    newest: int = 0


def find_scans(connection: sql.engine.Connection, wanted: ScanFilter) -> list[FoundScan]:
    """Return the scans that match a filter, the oldest first."""
    rows = [dict(row) for row in connection.execute(_query(wanted)).mappings()]
    counts = _counts(connection, [row['id'] for row in rows])
    return [_found(row, counts.get(row['id'], (0, 0)), wanted) for row in reversed(rows)]


def _query(wanted: ScanFilter) -> Any:
    columns = [
        SCANS.c.id,
        SCANS.c.scan_id,
        CELLS.c.name.label('cell'),
        PARTS.c.name.label('part'),
        RECIPES.c.name.label('recipe'),
        *(SCANS.c[name] for name in ('created', 'stage', 'code', 'verdict', 'deleted')),
    ]
    table = joined_scans()
    if wanted.feature:
        last = (
            sql.select(sql.func.max(VERDICTS.c.number))
            .where(VERDICTS.c.scan == SCANS.c.id)
            .scalar_subquery()
        )
        table = table.join(FEATURES, (FEATURES.c.scan == SCANS.c.id) & (FEATURES.c.number == last))
        columns += [column.label(f'feature_{column.name}') for column in FEATURES.c]
    query = sql.select(*columns).select_from(table).where(*_conditions(wanted))
    query = query.order_by(SCANS.c.created.desc(), SCANS.c.id.desc())
    return query.limit(wanted.newest) if wanted.newest else query


def joined_scans() -> Any:
    """Return the table of scans with the names of cell, part and recipe, and the calibration."""
    return (
        SCANS.join(CELLS, SCANS.c.cell == CELLS.c.id)
        .join(PARTS, SCANS.c.part == PARTS.c.id)
        .join(RECIPES, SCANS.c.recipe == RECIPES.c.id)
        .outerjoin(CALIBRATIONS, SCANS.c.calibration == CALIBRATIONS.c.id)
    )


def _conditions(wanted: ScanFilter) -> list[Any]:
    equal = {
        CELLS.c.name: wanted.cell,
        PARTS.c.name: wanted.part,
        RECIPES.c.name: wanted.recipe,
        SCANS.c.code: wanted.code,
        SCANS.c.verdict: wanted.verdict,
    }
    if wanted.feature:
        equal[FEATURES.c.feature] = wanted.feature
        equal[FEATURES.c.characteristic] = wanted.characteristic
    found: list[Any] = [column == value for column, value in equal.items() if value]
    if wanted.calibration:
        found.append(CALIBRATIONS.c.sha256.startswith(wanted.calibration, autoescape=True))
    if wanted.since:
        found.append(SCANS.c.created >= wanted.since)
    if wanted.until:
        found.append(SCANS.c.created < wanted.until)
    return [*found, SCANS.c.deleted != '' if wanted.deleted else SCANS.c.deleted == '']


def _counts(connection: sql.engine.Connection, keys: Sequence[int]) -> dict[int, tuple[int, int]]:
    """Return the number of views and profiles by scan."""
    found = {}
    unique = sorted(set(keys))
    for begin in range(0, len(unique), _BLOCK):
        query = (
            sql.select(VIEWS.c.scan, sql.func.count(), sql.func.sum(VIEWS.c.profiles))
            .where(VIEWS.c.scan.in_(unique[begin : begin + _BLOCK]))
            .group_by(VIEWS.c.scan)
        )
        found.update(
            {scan: (views, int(count)) for scan, views, count in connection.execute(query)}
        )
    return found


def _found(row: Mapping[str, Any], counts: tuple[int, int], wanted: ScanFilter) -> FoundScan:
    names = ('scan_id', 'cell', 'part', 'recipe', 'created', 'stage', 'code', 'verdict', 'deleted')
    value = None
    if wanted.feature:
        value = FeatureRow(
            **{name: row[f'feature_{name}'] for name in FeatureRow.__dataclass_fields__}
        )
    views, profiles = counts
    return FoundScan(
        **{name: row[name] for name in names}, views=views, profiles=profiles, value=value
    )
