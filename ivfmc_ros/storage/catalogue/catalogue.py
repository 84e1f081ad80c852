# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Catalogue: database of scans, their views, profiles and results.

The points themselves are in the bags; a row of a profile has the offset of its chunk. The database
is ``catalogue.sqlite3`` in the folder of the scans, or that of a plant (``IVFMC_CATALOGUE``).
Several processes write to it, each a few rows per transaction.
"""

from collections.abc import Mapping
from collections.abc import Sequence
from datetime import datetime
from datetime import UTC
import json
from pathlib import Path
from pathlib import PurePath
from typing import Any

import sqlalchemy as sql

from ivfmc_ros.errors import CatalogueError
from ivfmc_ros.storage.catalogue.database import cell_of_environment
from ivfmc_ros.storage.catalogue.database import Database
from ivfmc_ros.storage.catalogue.database import url_of_environment
from ivfmc_ros.storage.catalogue.rows import FeatureRow
from ivfmc_ros.storage.catalogue.rows import FoundScan
from ivfmc_ros.storage.catalogue.rows import ProfileRow
from ivfmc_ros.storage.catalogue.rows import ResultRow
from ivfmc_ros.storage.catalogue.rows import ScanRow
from ivfmc_ros.storage.catalogue.rows import ViewRow
from ivfmc_ros.storage.catalogue.schema import CALIBRATIONS
from ivfmc_ros.storage.catalogue.schema import CELLS
from ivfmc_ros.storage.catalogue.schema import FEATURES
from ivfmc_ros.storage.catalogue.schema import OF_A_SCAN
from ivfmc_ros.storage.catalogue.schema import PARTS
from ivfmc_ros.storage.catalogue.schema import PROFILES
from ivfmc_ros.storage.catalogue.schema import RECIPES
from ivfmc_ros.storage.catalogue.schema import RESULTS
from ivfmc_ros.storage.catalogue.schema import SCANS
from ivfmc_ros.storage.catalogue.schema import VERDICTS
from ivfmc_ros.storage.catalogue.schema import VIEWS
from ivfmc_ros.storage.catalogue.search import find_scans
from ivfmc_ros.storage.catalogue.search import joined_scans
from ivfmc_ros.storage.catalogue.search import ScanFilter
from ivfmc_ros.storage.recording.profile_location import ProfileLocation

FILE_NAME = 'catalogue.sqlite3'

# SQLite busy timeout, seconds: how long a transaction waits for the lock of another process.
_BUSY_TIMEOUT_S = 15.0
# Part of the folder of scans that stands for the name of a cell.
CELL_FIELD = '{cell}'


class Catalogue:
    """
    The catalogue of the scans of a cell or a plant.

    cell : name of the cell whose scans are added
    """

    def __init__(
        self,
        root: Path,
        *,
        create: bool = False,
        timeout_s: float = _BUSY_TIMEOUT_S,
        url: str | None = None,
        cell: str | None = None,
    ) -> None:
        """
        Open a catalogue; one of an earlier version is upgraded.

        root : folder of the scans on this machine; ``{cell}`` in it stands for the name of the
            cell, where one database has the scans of several
        create : create folder and catalogue where they do not exist
        timeout_s : maximum time to wait for the lock of another process, seconds
        url : database, such as postgresql+psycopg://host/ivfmc; '': ``catalogue.sqlite3`` in
            ``root``; None: environment variable IVFMC_CATALOGUE
        cell : None: environment variable IVFMC_CELL
        :raises CatalogueError: the catalogue does not exist, or is of a later version
        """
        url = url_of_environment() if url is None else url
        self.root = root
        self.cell = cell_of_environment(url) if cell is None else cell
        folder = folder_of_cell(root, self.cell)
        self.path = folder / FILE_NAME
        if create:
            _make_folder(folder)
        elif not url and not self.path.is_file():
            raise CatalogueError(
                f'{self.path}: does not exist; no scan was recorded in this folder'
            )
        self.database = Database(self.path, url, create=create, timeout_s=timeout_s)

    def close(self) -> None:
        """Close the connections to the database."""
        self.database.close()

    def add_scan(
        self, scan_id: str, part: str, recipe: str, stage: str, parameters: Mapping[str, Any]
    ) -> None:
        """
        Add a scan of this cell, whose folder has its id as name.

        parameters : JSON-serializable
        :raises CatalogueError: the scan exists, or the database cannot be written
        """
        with self.database.write() as connection:
            self.insert_scan(
                connection,
                {
                    'scan_id': scan_id,
                    'created': _now(),
                    'stage': stage,
                    'code': '',
                    'folder': scan_id,
                    'parameters': json.dumps(parameters),
                },
                part=part,
                recipe=recipe,
            )

    def insert_scan(
        self,
        connection: sql.engine.Connection,
        values: Mapping[str, Any],
        *,
        part: str,
        recipe: str,
        cell: str | None = None,
    ) -> int:
        """Insert the row of a scan, of this cell by default, and return its key."""
        row = {
            'verdict': '',
            'deleted': '',
            **values,
            'cell': self._name(connection, CELLS, self.cell if cell is None else cell),
            'part': self._name(connection, PARTS, part),
            'recipe': self._name(connection, RECIPES, recipe),
        }
        result = connection.execute(sql.insert(SCANS).values(**row).returning(SCANS.c.id))
        return int(result.scalar_one())

    def _name(self, connection: sql.engine.Connection, table: sql.Table, name: str) -> int:
        """Return the key of a name, which is added where it is new."""
        query = sql.select(table.c.id).where(table.c.name == name)
        key = connection.execute(query).scalar_one_or_none()
        if key is None:
            insert = self.database.insert(table).values(name=name)
            connection.execute(insert.on_conflict_do_nothing(index_elements=['name']))
            key = connection.execute(query).scalar_one()
        return int(key)

    def set_stage(self, scan_id: str, stage: str, code: str = '') -> None:
        """Update the stage of a scan; ``code`` is OK, that of an error, or '' while it runs."""
        self.update_scan(scan_id, stage=stage, code=code)

    def update_scan(self, scan_id: str, **values: Any) -> None:
        """
        Update columns of a scan.

        :raises CatalogueError: the scan does not exist
        """
        key = self.scan(scan_id).key
        with self.database.write() as connection:
            connection.execute(sql.update(SCANS).where(SCANS.c.id == key).values(**values))

    def add_profiles(self, scan_id: str, locations: Sequence[ProfileLocation]) -> None:
        """
        Add profiles that are in the bag, and update the rows of their views.

        Profiles that were added already are left as they are.

        :raises CatalogueError: the scan does not exist, or has another profile of that seq
        """
        key = self.scan(scan_id).key
        with self.database.write() as connection:
            self.insert_profiles(connection, key, locations)

    def insert_profiles(
        self, connection: sql.engine.Connection, key: int, locations: Sequence[ProfileLocation]
    ) -> None:
        """:raises CatalogueError: the scan has another profile of a seq."""
        if not locations:
            return
        rows = {location.header.seq: _profile_values(key, location) for location in locations}
        # an update whose answer was lost with the connection is repeated
        known = connection.execute(
            sql.select(PROFILES).where(
                PROFILES.c.scan == key, PROFILES.c.seq.between(min(rows), max(rows))
            )
        ).mappings()
        for row in known:
            new = rows.pop(row['seq'], None)
            if new is not None and (new['stamp_ns'], new['message']) != (
                row['stamp_ns'],
                row['message'],
            ):
                raise CatalogueError(
                    f'{self.database.label}: has another profile {row["seq"]} of this scan'
                )
        if not rows:
            return
        connection.execute(sql.insert(PROFILES), list(rows.values()))
        for view in sorted({row['view'] for row in rows.values()}):
            self.update_view(connection, key, view)

    def add_result(self, scan_id: str, folder: str, summary: Mapping[str, Any]) -> None:
        """Add a result; ``folder`` is relative to the folder of the scans, or absolute."""
        scan = self.scan(scan_id)
        root = folder_of_cell(self.root, scan.cell).absolute()
        if Path(folder).is_relative_to(root):
            folder = str(Path(folder).relative_to(root))
        with self.database.write() as connection:
            # the row of the scan is locked: two results must not get one number
            connection.execute(
                sql.select(SCANS.c.id).where(SCANS.c.id == scan.key).with_for_update()
            ).one()
            number = connection.execute(
                sql.select(sql.func.count()).where(RESULTS.c.scan == scan.key)
            ).scalar_one()
            row = {
                'scan': scan.key,
                'number': number,
                'created': _now(),
                'folder': folder,
                'summary': json.dumps(summary),
            }
            connection.execute(sql.insert(RESULTS), [row])

    def remove_rows(self, connection: sql.engine.Connection, key: int) -> None:
        """Remove a scan with all that belongs to it."""
        for table in OF_A_SCAN:
            connection.execute(sql.delete(table).where(table.c.scan == key))
        connection.execute(sql.delete(SCANS).where(SCANS.c.id == key))

    def scans(self) -> list[ScanRow]:
        """Return all scans that are not deleted, by time of creation."""
        order = SCANS.c.created, SCANS.c.scan_id
        rows = self._select(_scan_query().where(SCANS.c.deleted == '').order_by(*order))
        return [self._scan_row(row) for row in rows]

    def scans_of(self, scan_id: str) -> list[ScanRow]:
        """Return the scans of an id, deleted ones too; several cells may have one each."""
        rows = self._select(_scan_query().where(SCANS.c.scan_id == scan_id))
        return [self._scan_row(row) for row in rows]

    def find(self, wanted: ScanFilter) -> list[FoundScan]:
        """Return the scans that match a filter, the oldest first."""
        with self.database.read() as connection:
            return find_scans(connection, wanted)

    def scan(self, scan_id: str) -> ScanRow:
        """
        Return a scan by its id, or by cell and id as CELL/SCAN_ID.

        :raises CatalogueError: the scan does not exist (the message lists the last ones), or
            several cells have one of that id, and this cell has none
        """
        cell, _, name = scan_id.rpartition('/')
        rows = self._select(_scan_query().where(SCANS.c.scan_id == name))
        found = [row for row in rows if not cell or row['cell'] == cell]
        if len(found) > 1:
            own = [row for row in found if row['cell'] == self.cell]
            if not own:
                names = ', '.join(sorted(f'{row["cell"]}/{name}' for row in found))
                raise CatalogueError(f'{self.database.label}: several cells have it: {names}')
            found = own
        if not found:
            last = ', '.join(row.scan_id for row in self.find(ScanFilter(newest=3))) or 'none'
            raise CatalogueError(
                f'{self.database.label}: has no scan {scan_id!r}; the last are {last}'
            )
        return self._scan_row(found[0])

    def views(self, scan_id: str) -> list[ViewRow]:
        """Return the views of a scan by number."""
        rows = self._rows(VIEWS, scan_id, VIEWS.c.view)
        return [ViewRow(**row) for row in rows]

    def profiles(self, scan_id: str) -> list[ProfileRow]:
        """Return the profiles of a scan by seq."""
        rows = self._rows(PROFILES, scan_id, PROFILES.c.seq)
        return [ProfileRow(**row) for row in rows]

    def results(self, scan_id: str) -> list[ResultRow]:
        """Return the results of a scan, oldest first."""
        root = folder_of_cell(self.root, self.scan(scan_id).cell)
        return [
            ResultRow(
                number=row['number'],
                created=row['created'],
                folder=root / row['folder'],
                summary=json.loads(row['summary']),
            )
            for row in self._rows(RESULTS, scan_id, RESULTS.c.number)
        ]

    def features(self, scan_id: str) -> list[FeatureRow]:
        """Return what the last inspection of a scan measured."""
        key = self.scan(scan_id).key
        last = sql.select(sql.func.max(VERDICTS.c.number)).where(VERDICTS.c.scan == key)
        query = sql.select(FEATURES).where(
            FEATURES.c.scan == key, FEATURES.c.number == last.scalar_subquery()
        )
        rows = self._select(query.order_by(FEATURES.c.feature, FEATURES.c.characteristic))
        names = FeatureRow.__dataclass_fields__
        return [FeatureRow(**{name: row[name] for name in names}) for row in rows]

    def _rows(self, table: sql.Table, scan_id: str, order: Any) -> list[dict[str, Any]]:
        key = self.scan(scan_id).key
        rows = self._select(sql.select(table).where(table.c.scan == key).order_by(order))
        return [{name: row[name] for name in row if name != 'scan'} for row in rows]

    def _scan_row(self, row: Mapping[str, Any]) -> ScanRow:
        values = dict(row)
        values['key'] = values.pop('id')
        self._require_inside(values)
        values['folder'] = folder_of_cell(self.root, values['cell']) / values['folder']
        values['parameters'] = json.loads(values['parameters'])
        return ScanRow(**values)

    def _require_inside(self, values: Mapping[str, Any]) -> None:
        """:raises CatalogueError: a row names a folder outside of that of the scans."""
        folder, cell = PurePath(values['folder']), values['cell']
        is_inside = folder.parts and not folder.is_absolute() and '..' not in folder.parts
        is_name = '/' not in cell and cell not in ('.', '..')
        if not is_inside or (CELL_FIELD in str(self.root) and not is_name):
            raise CatalogueError(
                f'{self.database.label}: scan {values["scan_id"]!r}: its folder '
                f'{values["folder"]!r} of cell {cell!r} is not below {self.root}'
            )

    def _select(self, query: Any) -> list[Mapping[str, Any]]:
        with self.database.read() as connection:
            return [dict(row) for row in connection.execute(query).mappings()]

    def update_view(self, connection: sql.engine.Connection, key: int, view: int) -> None:
        """Insert or update the row of a view from the rows of its profiles."""
        counted = connection.execute(
            sql.select(
                sql.func.min(PROFILES.c.laser).label('laser'),
                sql.func.count().label('profiles'),
                sql.func.sum(PROFILES.c.points).label('points'),
                sql.func.min(PROFILES.c.angle).label('first_angle'),
                sql.func.max(PROFILES.c.angle).label('last_angle'),
            ).where(PROFILES.c.scan == key, PROFILES.c.view == view)
        ).mappings()
        values = dict(counted.one())
        row = self.database.insert(VIEWS).values(scan=key, view=view, **values)
        connection.execute(row.on_conflict_do_update(index_elements=['scan', 'view'], set_=values))


def folder_of_cell(root: Path, cell: str) -> Path:
    """Return the folder of the scans of a cell: ``{cell}`` in ``root`` is its name."""
    return Path(str(root).replace(CELL_FIELD, cell))


def _scan_query() -> Any:
    names = ('id', 'scan_id', 'created', 'stage', 'code', 'verdict', 'folder', 'parameters')
    return sql.select(
        *(SCANS.c[name] for name in names),
        SCANS.c.deleted,
        sql.func.coalesce(CALIBRATIONS.c.sha256, '').label('calibration'),
        CELLS.c.name.label('cell'),
        PARTS.c.name.label('part'),
        RECIPES.c.name.label('recipe'),
    ).select_from(joined_scans())


def _profile_values(key: int, location: ProfileLocation) -> dict[str, Any]:
    return {
        'scan': key,
        'topic': location.topic,
        'message': location.index,
        'log_time_ns': location.log_time_ns,
        'chunk_offset': location.chunk_offset,
        **vars(location.header),
    }


def _make_folder(root: Path) -> None:
    try:
        root.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CatalogueError(f'{root}: cannot be created: {error.strerror or error}') from error


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec='milliseconds').replace('+00:00', 'Z')
