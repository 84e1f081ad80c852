# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
``catalogue.sqlite3``: database of the scans of a folder, their views, profiles and results.

The points themselves are in the bags; a row of a profile has the offset of its chunk. Several
processes write to the file, each a few rows per transaction.
"""

from collections.abc import Iterator
from collections.abc import Mapping
from collections.abc import Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from datetime import UTC
import json
from pathlib import Path
from typing import Any

import sqlalchemy as sql
from sqlalchemy.dialects.sqlite import insert
from sqlalchemy.exc import SQLAlchemyError

from ivfmc_ros.errors import CatalogueBusyError
from ivfmc_ros.errors import CatalogueError
from ivfmc_ros.storage.recording.live_recorder import ProfileLocation

FILE_NAME = 'catalogue.sqlite3'

# SQLite busy timeout, seconds: how long a transaction waits for the lock of another process.
_BUSY_TIMEOUT_S = 15.0
# Value of PRAGMA user_version; a file with another one is refused.
_SCHEMA_VERSION = 1

_META = sql.MetaData()
_SCANS = sql.Table(
    'scans',
    _META,
    sql.Column('scan_id', sql.String, primary_key=True),
    sql.Column('part', sql.String, nullable=False, index=True),
    sql.Column('recipe', sql.String, nullable=False),
    sql.Column('created', sql.String, nullable=False, index=True),
    sql.Column('stage', sql.String, nullable=False),
    sql.Column('code', sql.String, nullable=False),
    sql.Column('folder', sql.String, nullable=False),  # relative to the catalogue
    sql.Column('parameters', sql.String, nullable=False),  # JSON
)
_VIEWS = sql.Table(
    'views',
    _META,
    sql.Column('scan_id', sql.ForeignKey('scans.scan_id'), primary_key=True),
    sql.Column('view', sql.Integer, primary_key=True),
    sql.Column('laser', sql.Integer, nullable=False),
    sql.Column('profiles', sql.Integer, nullable=False),
    sql.Column('points', sql.Integer, nullable=False),
    sql.Column('first_angle', sql.Float, nullable=False),
    sql.Column('last_angle', sql.Float, nullable=False),
)
_PROFILES = sql.Table(
    'profiles',
    _META,
    sql.Column('scan_id', sql.ForeignKey('scans.scan_id'), primary_key=True),
    sql.Column('seq', sql.Integer, primary_key=True),
    sql.Column('view', sql.Integer, nullable=False),
    sql.Column('laser', sql.Integer, nullable=False),
    sql.Column('angle', sql.Float, nullable=False),
    sql.Column('points', sql.Integer, nullable=False),
    sql.Column('stamp_ns', sql.BigInteger, nullable=False),
    sql.Column('topic', sql.String, nullable=False),
    sql.Column('message', sql.Integer, nullable=False),  # index in the topic, from 0
    sql.Column('log_time_ns', sql.BigInteger, nullable=False),
    sql.Column('chunk_offset', sql.BigInteger, nullable=False),
)
_RESULTS = sql.Table(
    'results',
    _META,
    sql.Column('scan_id', sql.ForeignKey('scans.scan_id'), primary_key=True),
    sql.Column('number', sql.Integer, primary_key=True),
    sql.Column('created', sql.String, nullable=False),
    sql.Column('folder', sql.String, nullable=False),
    sql.Column('summary', sql.String, nullable=False),  # JSON
)


@dataclass(frozen=True, kw_only=True)
class ScanRow:
    """A scan; ``folder`` has its files, ``created`` is ISO 8601 in UTC."""

    scan_id: str
    part: str
    recipe: str
    created: str
    stage: str
    code: str
    folder: Path
    parameters: Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class ViewRow:
    """A view: number of profiles and points, smallest and greatest table angle in radians."""

    view: int
    laser: int
    profiles: int
    points: int
    first_angle: float
    last_angle: float


@dataclass(frozen=True, kw_only=True)
class ProfileRow:
    """
    A profile and its location in the bag; angle in radians.

    message : index of the message in ``topic``, from 0
    chunk_offset : offset in the file of the chunk that holds the message, bytes
    """

    seq: int
    view: int
    laser: int
    angle: float
    points: int
    stamp_ns: int
    topic: str
    message: int
    log_time_ns: int
    chunk_offset: int


@dataclass(frozen=True, kw_only=True)
class ResultRow:
    """A result (mesh) of a scan; one that is reconstructed with other settings has several."""

    number: int
    created: str
    folder: Path
    summary: Mapping[str, Any]


class Catalogue:
    """The catalogue of the scans in a folder."""

    def __init__(
        self, root: Path, *, create: bool = False, timeout_s: float = _BUSY_TIMEOUT_S
    ) -> None:
        """
        Open the catalogue of a folder of scans.

        create : create folder and catalogue where they do not exist
        timeout_s : maximum time to wait for the lock of another process, seconds
        :raises CatalogueError: the file does not exist, or is not a catalogue of this version
        """
        self.root = root
        self.path = root / FILE_NAME
        if create:
            _make_folder(root)
        elif not self.path.is_file():
            raise CatalogueError(
                f'{self.path}: does not exist; no scan was recorded in this folder'
            )
        self._engine = sql.create_engine(
            sql.engine.URL.create('sqlite', database=str(self.path)),
            connect_args={'timeout': timeout_s},
            future=True,
        )
        with self._begin() as connection:
            if not _has_tables(connection, self.path):
                _META.create_all(connection)
                connection.execute(sql.text(f'PRAGMA user_version = {_SCHEMA_VERSION}'))

    def close(self) -> None:
        """Close the connections to the file."""
        self._engine.dispose()

    def add_scan(
        self, scan_id: str, part: str, recipe: str, stage: str, parameters: Mapping[str, Any]
    ) -> None:
        """
        Add a scan, whose folder has its id as name.

        parameters : JSON-serializable
        :raises CatalogueError: the scan exists, or the file cannot be written
        """
        row = {
            'scan_id': scan_id,
            'part': part,
            'recipe': recipe,
            'created': _now(),
            'stage': stage,
            'code': '',
            'folder': scan_id,
            'parameters': json.dumps(parameters),
        }
        with self._begin() as connection:
            connection.execute(sql.insert(_SCANS), [row])

    def set_stage(self, scan_id: str, stage: str, code: str = '') -> None:
        """Update the stage of a scan; ``code`` is OK, that of an error, or '' while it runs."""
        with self._begin() as connection:
            changed = connection.execute(
                sql.update(_SCANS)
                .where(_SCANS.c.scan_id == scan_id)
                .values(stage=stage, code=code)
            )
            if not changed.rowcount:
                raise CatalogueError(f'{self.path}: has no scan {scan_id!r}')

    def add_profiles(self, scan_id: str, locations: Sequence[ProfileLocation]) -> None:
        """Add profiles that are in the bag, and update the rows of their views."""
        rows = [
            {
                'scan_id': scan_id,
                'topic': location.topic,
                'message': location.index,
                'log_time_ns': location.log_time_ns,
                'chunk_offset': location.chunk_offset,
                **vars(location.header),
            }
            for location in locations
        ]
        if not rows:
            return
        views = sorted({location.header.view for location in locations})
        with self._begin() as connection:
            connection.execute(sql.insert(_PROFILES), rows)
            for view in views:
                _update_view(connection, scan_id, view)

    def add_result(self, scan_id: str, folder: str, summary: Mapping[str, Any]) -> None:
        """Add a result; ``folder`` is relative to the catalogue's folder, or absolute."""
        self.scan(scan_id)
        with self._begin() as connection:
            number = connection.execute(
                sql.select(sql.func.count()).where(_RESULTS.c.scan_id == scan_id)
            ).scalar_one()
            row = {
                'scan_id': scan_id,
                'number': number,
                'created': _now(),
                'folder': folder,
                'summary': json.dumps(summary),
            }
            connection.execute(sql.insert(_RESULTS), [row])

    def scans(self) -> list[ScanRow]:
        """Return all scans by time of creation."""
        rows = self._select(sql.select(_SCANS).order_by(_SCANS.c.created, _SCANS.c.scan_id))
        return [self._scan_row(row) for row in rows]

    def scan(self, scan_id: str) -> ScanRow:
        """
        Return a scan by its id.

        :raises CatalogueError: the scan does not exist; the message lists the last ones
        """
        rows = self._select(sql.select(_SCANS).where(_SCANS.c.scan_id == scan_id))
        if not rows:
            last = ', '.join(row.scan_id for row in self.scans()[-3:]) or 'none'
            raise CatalogueError(f'{self.path}: has no scan {scan_id!r}; the last are {last}')
        return self._scan_row(rows[0])

    def views(self, scan_id: str) -> list[ViewRow]:
        """Return the views of a scan by number."""
        query = sql.select(_VIEWS).where(_VIEWS.c.scan_id == scan_id).order_by(_VIEWS.c.view)
        return [ViewRow(**_without_id(row)) for row in self._select(query)]

    def profiles(self, scan_id: str) -> list[ProfileRow]:
        """Return the profiles of a scan by seq."""
        query = sql.select(_PROFILES).where(_PROFILES.c.scan_id == scan_id)
        rows = self._select(query.order_by(_PROFILES.c.seq))
        return [ProfileRow(**_without_id(row)) for row in rows]

    def results(self, scan_id: str) -> list[ResultRow]:
        """Return the results of a scan, oldest first."""
        query = sql.select(_RESULTS).where(_RESULTS.c.scan_id == scan_id)
        return [
            ResultRow(
                number=row['number'],
                created=row['created'],
                folder=self.root / row['folder'],
                summary=json.loads(row['summary']),
            )
            for row in self._select(query.order_by(_RESULTS.c.number))
        ]

    def _scan_row(self, row: Mapping[str, Any]) -> ScanRow:
        values = dict(row)
        values['folder'] = self.root / values['folder']
        values['parameters'] = json.loads(values['parameters'])
        return ScanRow(**values)

    def _select(self, query: Any) -> list[Mapping[str, Any]]:
        with self._begin() as connection:
            return [dict(row) for row in connection.execute(query).mappings()]

    @contextmanager
    def _begin(self) -> Iterator[sql.engine.Connection]:
        try:
            with self._engine.begin() as connection:
                yield connection
        except SQLAlchemyError as error:
            reason = getattr(error, 'orig', None) or error
            kind = CatalogueBusyError if 'database is locked' in str(reason) else CatalogueError
            raise kind(f'{self.path}: {reason}') from error


def _make_folder(root: Path) -> None:
    try:
        root.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CatalogueError(f'{root}: cannot be created: {error.strerror or error}') from error


def _has_tables(connection: sql.engine.Connection, path: Path) -> bool:
    version = connection.execute(sql.text('PRAGMA user_version')).scalar_one()
    if version not in (0, _SCHEMA_VERSION):
        raise CatalogueError(
            f'{path}: is a catalogue of version {version}, this program reads {_SCHEMA_VERSION}'
        )
    return bool(version == _SCHEMA_VERSION)


def _update_view(connection: sql.engine.Connection, scan_id: str, view: int) -> None:
    """Insert or update the row of a view from the rows of its profiles."""
    of_view = (_PROFILES.c.scan_id == scan_id) & (_PROFILES.c.view == view)
    counted = connection.execute(
        sql.select(
            sql.func.min(_PROFILES.c.laser).label('laser'),
            sql.func.count().label('profiles'),
            sql.func.sum(_PROFILES.c.points).label('points'),
            sql.func.min(_PROFILES.c.angle).label('first_angle'),
            sql.func.max(_PROFILES.c.angle).label('last_angle'),
        ).where(of_view)
    ).mappings()
    values = dict(counted.one())
    row = insert(_VIEWS).values(scan_id=scan_id, view=view, **values)
    connection.execute(row.on_conflict_do_update(index_elements=['scan_id', 'view'], set_=values))


def _without_id(row: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in row.items() if key != 'scan_id'}


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec='milliseconds').replace('+00:00', 'Z')
