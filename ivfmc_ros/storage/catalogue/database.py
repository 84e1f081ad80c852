# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Connections to the database of a catalogue: SQLite in a file, or another one by its URL.

SQLite runs in WAL mode, so that a reader does not wait for a writer. PostgreSQL is reached by
``postgresql+psycopg://USER:PASSWORD@HOST/DATABASE`` (extra ``postgresql``).
"""

from collections.abc import Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import socket
from typing import Any

import sqlalchemy as sql
from sqlalchemy.exc import DBAPIError
from sqlalchemy.exc import InterfaceError
from sqlalchemy.exc import NoSuchModuleError
from sqlalchemy.exc import OperationalError
from sqlalchemy.exc import SQLAlchemyError

from ivfmc_ros.errors import CatalogueBusyError
from ivfmc_ros.errors import CatalogueError
from ivfmc_ros.storage.catalogue.upgrade import upgrade_schema

# URL of the database of a plant; without it the catalogue is a file beside the scans.
URL_VARIABLE = 'IVFMC_CATALOGUE'
# Name of the cell whose scans this machine records.
CELL_VARIABLE = 'IVFMC_CELL'
# Name of the cell where none is given and the catalogue is its own.
_ONLY_CELL = 'cell'
# Seconds until a server that does not answer is given up.
_CONNECT_S = 5


def url_of_environment() -> str:
    """Return the URL of the plant's database, '' where the catalogue is a file."""
    return os.environ.get(URL_VARIABLE, '')


def cell_of_environment(url: str) -> str:
    """Return the name of this cell: IVFMC_CELL, or the host in the database of a plant."""
    return os.environ.get(CELL_VARIABLE, '') or (socket.gethostname() if url else _ONLY_CELL)


class Database:
    """
    A database with the tables of a catalogue.

    label : file or URL without password, for messages
    """

    def __init__(self, file: Path, url: str, *, create: bool, timeout_s: float) -> None:
        """
        Connect; a database of an earlier version is upgraded.

        file : SQLite file, where ``url`` is ''
        create : create the tables where there are none
        timeout_s : time to wait for the lock of another process, seconds (SQLite)
        :raises CatalogueBusyError: the database is locked, or its server does not answer
        :raises CatalogueError: it is not a catalogue, or one of a later version
        """
        self.label = str(file)
        try:
            self._engine = _engine(file, url, timeout_s)
        except (NoSuchModuleError, ModuleNotFoundError, SQLAlchemyError, ValueError) as error:
            raise CatalogueError(f'{_without_password(url)}: cannot be used: {error}') from error
        if url:
            self.label = self._engine.url.render_as_string(hide_password=True)
        with self._named_errors():
            upgrade_schema(self._engine, self.label, create=create)

    @property
    def is_file(self) -> bool:
        """Whether the database is a file."""
        return self._engine.dialect.name == 'sqlite'

    @contextmanager
    def read(self) -> Iterator[sql.engine.Connection]:
        """
        Yield a connection in a transaction that only reads.

        :raises CatalogueError: a statement fails
        """
        with self._named_errors(), self._engine.begin() as connection:
            yield connection

    @contextmanager
    def write(self) -> Iterator[sql.engine.Connection]:
        """
        Yield a connection in a transaction that writes: all of it or nothing.

        :raises CatalogueError: a statement fails
        """
        engine = self._engine.execution_options(ivfmc_write=True)
        with self._named_errors(), engine.begin() as connection:
            yield connection

    def insert(self, table: sql.Table) -> Any:
        """Return an INSERT that has ``on_conflict_do_nothing`` and ``on_conflict_do_update``."""
        if self.is_file:
            from sqlalchemy.dialects.sqlite import insert
        else:
            from sqlalchemy.dialects.postgresql import insert  # type: ignore[assignment]
        return insert(table)

    def close(self) -> None:
        """Close the connections."""
        self._engine.dispose()

    @contextmanager
    def _named_errors(self) -> Iterator[None]:
        try:
            yield
        except SQLAlchemyError as error:
            reason = getattr(error, 'orig', None) or error
            kind = CatalogueBusyError if self._can_be_tried_again(error) else CatalogueError
            raise kind(f'{self.label}: {reason}') from error

    def _can_be_tried_again(self, error: SQLAlchemyError) -> bool:
        if not isinstance(error, DBAPIError):
            return False
        if self.is_file:
            return 'database is locked' in str(error.orig)
        # a server that was stopped, cannot be reached or has no free connection
        is_gone = isinstance(error, OperationalError | InterfaceError)
        return bool(error.connection_invalidated) or is_gone


def _engine(file: Path, url: str, timeout_s: float) -> sql.engine.Engine:
    if url:
        made = sql.engine.make_url(url)
        if made.get_backend_name() != 'postgresql':
            raise ValueError('only postgresql+psycopg:// is supported')
        # one connection a process: two hundred cells share the server
        return sql.create_engine(
            made,
            pool_size=1,
            max_overflow=4,
            pool_pre_ping=True,
            connect_args={'connect_timeout': _CONNECT_S},
        )
    engine = sql.create_engine(
        sql.engine.URL.create('sqlite', database=_sqlite_name(file), query=_sqlite_query(file)),
        connect_args={'timeout': timeout_s},
    )
    sql.event.listen(engine, 'connect', _on_connect)
    sql.event.listen(engine, 'begin', _on_begin)
    return engine


def _is_read_only(file: Path) -> bool:
    # WAL needs a file beside the database, which a read-only medium does not take
    return file.exists() and not os.access(file.parent, os.W_OK)


def _sqlite_name(file: Path) -> str:
    return f'file:{file}' if _is_read_only(file) else str(file)


def _sqlite_query(file: Path) -> dict[str, str]:
    return {'immutable': '1', 'uri': 'true'} if _is_read_only(file) else {}


def _on_connect(connection: Any, record: object) -> None:
    # the driver begins no transactions of its own, see _on_begin
    connection.isolation_level = None
    connection.execute('PRAGMA foreign_keys = ON')
    connection.execute('PRAGMA synchronous = NORMAL')


def _on_begin(connection: sql.engine.Connection) -> None:
    # a transaction that writes takes its lock at once: a later one could fail at a deadlock
    is_write = connection.get_execution_options().get('ivfmc_write')
    connection.exec_driver_sql('BEGIN IMMEDIATE' if is_write else 'BEGIN')


def _without_password(url: str) -> str:
    scheme, found, rest = url.partition('://')
    return f'{scheme}://{rest.rpartition("@")[2]}' if found else url
