# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Brings the tables of a catalogue to the newest version by its Alembic migrations."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
import sqlite3
import time
from typing import Any

import sqlalchemy as sql

from ivfmc_ros.errors import CatalogueBusyError
from ivfmc_ros.errors import CatalogueError

# Newest version of the tables; a test compares it with the migrations.
HEAD = '0002'
_KNOWN = ('0001', HEAD)
# Version 1 was made without Alembic, and has this number in PRAGMA user_version.
_FIRST_USER_VERSION = 1
# Seconds between tries to change the journal mode while another process makes the catalogue.
_WAL_RETRY_S = 0.02
# Number of the advisory lock of PostgreSQL under which one process migrates: any constant.
_LOCK = 1_907_202_617


def upgrade_schema(engine: sql.engine.Engine, label: str, *, create: bool) -> None:
    """
    Upgrade the tables of a database.

    label : of the database, for errors
    create : create the tables where there are none
    :raises CatalogueBusyError: other processes hold the lock of the file for too long
    :raises CatalogueError: the database has none, or those of a later version
    """
    with engine.begin() as connection:
        version = _version(connection, label)
    if version == HEAD:
        return
    if version is None and not create and engine.dialect.name != 'sqlite':
        raise CatalogueError(f'{label}: has no catalogue; no scan was recorded in this database')
    if engine.dialect.name == 'sqlite':
        _use_wal(engine, label)
    with engine.execution_options(ivfmc_write=True).begin() as connection:
        if engine.dialect.name == 'postgresql':
            connection.execute(sql.text(f'SELECT pg_advisory_xact_lock({_LOCK})'))
        # another process may have been faster
        if _version(connection, label) != HEAD:
            _migrate(connection, _version(connection, label))


def _use_wal(engine: sql.engine.Engine, label: str) -> None:
    """
    Let readers and a writer work at once, by SQLite's write-ahead log.

    The mode stays in the file; where the file system has no shared memory it stays as it is.
    SQLite does not wait for a lock here: it is tried again for the busy timeout of the connection.

    :raises CatalogueBusyError: other processes hold the lock for longer
    :raises CatalogueError: the file cannot be written
    """
    driver = engine.raw_connection()
    try:
        cursor = driver.cursor()
        (patience_ms,) = cursor.execute('PRAGMA busy_timeout').fetchone()
        deadline = time.monotonic() + 1e-3 * patience_ms
        while not _has_set_wal(cursor, label, is_last=time.monotonic() > deadline):
            time.sleep(_WAL_RETRY_S)
    finally:
        driver.close()


def _has_set_wal(cursor: Any, label: str, *, is_last: bool) -> bool:
    """Return whether the mode was set; :raises CatalogueError: it cannot be, or not in time."""
    try:
        cursor.execute('PRAGMA journal_mode = WAL')
    except sqlite3.OperationalError as error:
        if error.sqlite_errorcode & 0xFF != sqlite3.SQLITE_BUSY:
            raise CatalogueError(f'{label}: {error}') from error
        if is_last:
            raise CatalogueBusyError(f'{label}: {error}') from error
        return False
    return True


def _version(connection: sql.engine.Connection, label: str) -> str | None:
    """Return the version of the tables, None where there are none."""
    found = sql.inspect(connection)
    version: str | None = None
    if found.has_table('alembic_version'):
        version = connection.execute(
            sql.text('SELECT version_num FROM alembic_version')
        ).scalar_one_or_none()
    elif connection.dialect.name == 'sqlite':
        number = connection.execute(sql.text('PRAGMA user_version')).scalar_one()
        if number not in (0, _FIRST_USER_VERSION):
            version = str(number)
        elif number == _FIRST_USER_VERSION and found.has_table('scans'):
            version = _KNOWN[0]
    if version is not None and version not in _KNOWN:
        raise CatalogueError(
            f'{label}: is a catalogue of version {version}, this program reads up to {HEAD}; '
            'update ivfmc_ros'
        )
    return version


def _migrate(connection: sql.engine.Connection, version: str | None) -> None:
    # imported here: it takes longer than to open a catalogue that is up to date
    from alembic.runtime.environment import EnvironmentContext

    script = scripts()

    def steps(revision: Any, context: Any) -> Any:
        return script._upgrade_revs(HEAD, revision)

    with _stamped(connection, version), EnvironmentContext(_config(), script, fn=steps) as context:
        context.configure(connection=connection)
        context.run_migrations()


@contextmanager
def _stamped(connection: sql.engine.Connection, version: str | None) -> Iterator[None]:
    """Give a catalogue of version 1 the table in which Alembic finds its version."""
    has_table = sql.inspect(connection).has_table('alembic_version')
    if version is not None and not has_table:
        connection.execute(
            sql.text('CREATE TABLE alembic_version (version_num VARCHAR(32) NOT NULL PRIMARY KEY)')
        )
        connection.execute(
            sql.text('INSERT INTO alembic_version VALUES (:version)').bindparams(version=version)
        )
    yield


def scripts() -> Any:
    """Return the directory of migrations (alembic.script.ScriptDirectory)."""
    from alembic.script import ScriptDirectory

    return ScriptDirectory.from_config(_config())


def _config() -> Any:
    from alembic.config import Config

    config = Config()
    config.set_main_option('script_location', str(Path(__file__).parent / 'migrations'))
    return config
