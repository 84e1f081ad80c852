# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
import sqlite3
import time

from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
import pytest

from ivfmc_ros.errors import CatalogueBusyError
from ivfmc_ros.errors import CatalogueError
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.catalogue.catalogue import FILE_NAME
from ivfmc_ros.storage.catalogue.lost_profiles import remove_lost_profiles
from ivfmc_ros.storage.catalogue.schema import METADATA
from ivfmc_ros.storage.catalogue.upgrade import HEAD
from ivfmc_ros.storage.catalogue.upgrade import scripts
from ivfmc_ros.storage.messages.profile_header import ProfileHeader
from ivfmc_ros.storage.recording.profile_location import ProfileLocation

VERSION_1 = """
CREATE TABLE scans (scan_id VARCHAR PRIMARY KEY, part VARCHAR NOT NULL, recipe VARCHAR NOT NULL,
  created VARCHAR NOT NULL, stage VARCHAR NOT NULL, code VARCHAR NOT NULL,
  folder VARCHAR NOT NULL, parameters VARCHAR NOT NULL);
CREATE INDEX ix_scans_part ON scans (part);
CREATE INDEX ix_scans_created ON scans (created);
CREATE TABLE views (scan_id VARCHAR REFERENCES scans (scan_id), view INTEGER,
  laser INTEGER NOT NULL, profiles INTEGER NOT NULL, points INTEGER NOT NULL,
  first_angle FLOAT NOT NULL, last_angle FLOAT NOT NULL, PRIMARY KEY (scan_id, view));
CREATE TABLE profiles (scan_id VARCHAR REFERENCES scans (scan_id), seq INTEGER,
  view INTEGER NOT NULL, laser INTEGER NOT NULL, angle FLOAT NOT NULL, points INTEGER NOT NULL,
  stamp_ns BIGINT NOT NULL, topic VARCHAR NOT NULL, message INTEGER NOT NULL,
  log_time_ns BIGINT NOT NULL, chunk_offset BIGINT NOT NULL, PRIMARY KEY (scan_id, seq));
CREATE TABLE results (scan_id VARCHAR REFERENCES scans (scan_id), number INTEGER,
  created VARCHAR NOT NULL, folder VARCHAR NOT NULL, summary VARCHAR NOT NULL,
  PRIMARY KEY (scan_id, number));
PRAGMA user_version = 1;
"""


def location(seq, view=0):
    angle = 0.1 * seq
    header = ProfileHeader(seq=seq, view=view, laser=view, angle=angle, points=10, stamp_ns=seq)
    return ProfileLocation(
        header=header, topic='/p', index=seq, log_time_ns=100 + seq, chunk_offset=8
    )


@pytest.fixture
def catalogue(tmp_path):
    made = Catalogue(tmp_path / 'scans', create=True)
    made.add_scan('s1', 'bracket', '', 'SCANNING', {'profiles': 200})
    return made


def test_scan_is_found_with_its_folder_and_parameters(catalogue):
    row = catalogue.scan('s1')
    assert row.folder == catalogue.root / 's1'
    assert row.parameters == {'profiles': 200}
    assert (row.part, row.stage, row.code) == ('bracket', 'SCANNING', '')


def test_stage_changes(catalogue):
    catalogue.set_stage('s1', 'DONE', 'OK')
    assert catalogue.scan('s1').code == 'OK'


def test_profiles_that_the_bag_lost_are_removed_with_their_views(catalogue):
    places = [location(seq, view=min(seq // 2, 2)) for seq in range(6)]
    catalogue.add_profiles('s1', places)
    remove_lost_profiles(catalogue, 's1', 3)
    assert [row.seq for row in catalogue.profiles('s1')] == [0, 1, 2]
    assert [(row.view, row.profiles) for row in catalogue.views('s1')] == [(0, 2), (1, 1)]


def test_views_are_counted_from_their_profiles(catalogue):
    catalogue.add_profiles('s1', [location(0), location(1)])
    catalogue.add_profiles('s1', [location(2), location(3, view=1)])
    first, second = catalogue.views('s1')
    assert (first.profiles, first.points, first.last_angle) == (3, 30, pytest.approx(0.2))
    assert (second.view, second.laser, second.profiles) == (1, 1, 1)
    assert [row.message for row in catalogue.profiles('s1')] == [0, 1, 2, 3]
    assert catalogue.profiles('s1')[2].log_time_ns == 102


def test_results_are_numbered(catalogue, tmp_path):
    catalogue.add_result('s1', 's1', {'faces': 12})
    catalogue.add_result('s1', str(tmp_path / 'other'), {'faces': 13})
    rows = catalogue.results('s1')
    assert [(row.number, row.summary['faces']) for row in rows] == [(0, 12), (1, 13)]
    assert [row.folder for row in rows] == [catalogue.root / 's1', tmp_path / 'other']


def test_catalogue_is_found_again(catalogue):
    catalogue.close()
    assert [row.scan_id for row in Catalogue(catalogue.root).scans()] == ['s1']


def test_two_writers_wait_for_each_other(catalogue):
    other = Catalogue(catalogue.root)

    def write(number):
        target = catalogue if number % 2 else other
        target.add_profiles('s1', [location(number)])

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(write, range(40)))
    assert len(catalogue.profiles('s1')) == 40


def test_repeated_update_adds_no_profile_twice(catalogue):
    catalogue.add_profiles('s1', [location(0)])
    catalogue.add_profiles('s1', [location(0), location(1)])
    assert [row.seq for row in catalogue.profiles('s1')] == [0, 1]
    assert catalogue.views('s1')[0].profiles == 2


def test_another_profile_of_a_seq_is_refused(catalogue):
    catalogue.add_profiles('s1', [location(0)])
    other = replace(location(0), header=replace(location(0).header, stamp_ns=7))
    with pytest.raises(CatalogueError, match='another profile 0'):
        catalogue.add_profiles('s1', [other])


def test_scan_cannot_be_written_twice(catalogue):
    with pytest.raises(CatalogueError, match='UNIQUE'):
        catalogue.add_scan('s1', 'bracket', '', 'SCANNING', {})


@pytest.mark.parametrize('name', ["x' OR 1=1 --", '../x', 's2'])
def test_unknown_scan_is_refused_and_known_ones_are_listed(catalogue, name):
    with pytest.raises(CatalogueError, match='the last are s1'):
        catalogue.scan(name)
    with pytest.raises(CatalogueError, match='has no scan'):
        catalogue.set_stage(name, 'DONE')
    with pytest.raises(CatalogueError, match='has no scan'):
        catalogue.add_result(name, 'x', {})


def test_missing_catalogue_is_named(tmp_path):
    with pytest.raises(CatalogueError, match=FILE_NAME):
        Catalogue(tmp_path)


def test_file_that_is_not_a_catalogue_is_refused(tmp_path):
    (tmp_path / FILE_NAME).write_bytes(b'not a database at all' * 100)
    with pytest.raises(CatalogueError, match='not a database'):
        Catalogue(tmp_path)


def test_catalogue_of_a_later_version_is_refused(tmp_path):
    with sqlite3.connect(tmp_path / FILE_NAME) as connection:
        connection.execute('PRAGMA user_version = 99')
    with pytest.raises(CatalogueError, match='version 99'):
        Catalogue(tmp_path)


def test_read_only_catalogue_is_listed(tmp_path):
    Catalogue(tmp_path, create=True).add_scan('s1', 'part', '', 'DONE', {})
    # like the file of another user; root can write it all the same
    (tmp_path / FILE_NAME).chmod(0o444)
    connection = sqlite3.connect(tmp_path / FILE_NAME)
    connection.execute('BEGIN IMMEDIATE')
    begin = time.monotonic()
    assert [row.scan_id for row in Catalogue(tmp_path).scans()] == ['s1']
    assert time.monotonic() - begin < 5.0
    connection.close()


def test_tables_are_those_of_the_migrations(catalogue):
    assert scripts().get_current_head() == HEAD
    with catalogue.database.read() as connection:
        assert compare_metadata(MigrationContext.configure(connection), METADATA) == []


@pytest.fixture
def first_version(tmp_path):
    """Catalogue as version 1 wrote it, with a scan of two profiles and a result."""
    with sqlite3.connect(tmp_path / FILE_NAME) as connection:
        connection.executescript(VERSION_1)
        scan = ('s1', 'bracket', 'fine', '2026-11-23T10:00:00.000Z', 'DONE', 'OK', 's1')
        connection.execute(
            'INSERT INTO scans VALUES (?, ?, ?, ?, ?, ?, ?, ?)', (*scan, '{"profiles": 2}')
        )
        connection.execute("INSERT INTO views VALUES ('s1', 0, 1, 2, 20, 0.0, 0.1)")
        for seq in range(2):
            values = 's1', seq, 0, 1, 0.1 * seq, 10, 100 + seq, '/p', seq, 200 + seq, 64
            connection.execute(f'INSERT INTO profiles VALUES ({", ".join("?" * 11)})', values)
        connection.execute("INSERT INTO results VALUES ('s1', 0, '2026', 's1', '{}')")
    return tmp_path


def test_earlier_catalogue_is_upgraded_and_keeps_its_rows(first_version):
    catalogue = Catalogue(first_version)
    scan = catalogue.scan('s1')
    assert (scan.part, scan.recipe, scan.code) == ('bracket', 'fine', 'OK')
    assert scan.parameters == {'profiles': 2}
    assert scan.folder == first_version / 's1'
    assert [row.profiles for row in catalogue.views('s1')] == [2]
    assert [row.stamp_ns for row in catalogue.profiles('s1')] == [100, 101]
    assert len(catalogue.results('s1')) == 1
    with catalogue.database.read() as connection:
        assert compare_metadata(MigrationContext.configure(connection), METADATA) == []
    catalogue.add_profiles('s1', [location(2)])
    assert Catalogue(first_version).views('s1')[0].profiles == 3


def test_catalogue_of_a_later_migration_is_refused_by_its_version(catalogue):
    with catalogue.database.write() as connection:
        connection.exec_driver_sql("UPDATE alembic_version SET version_num = '0099'")
    with pytest.raises(CatalogueError, match=r'version 0099, this program reads up to 0002'):
        Catalogue(catalogue.root)


def test_processes_that_create_a_catalogue_at_once_make_one(tmp_path):
    with ThreadPoolExecutor(4) as pool:
        made = list(pool.map(lambda _: Catalogue(tmp_path, create=True), range(4)))
    made[0].add_scan('s1', 'part', '', 'DONE', {})
    assert [row.scan_id for row in made[3].scans()] == ['s1']


def test_catalogue_that_another_process_is_making_is_waited_for(tmp_path):
    other = sqlite3.connect(tmp_path / 'catalogue.sqlite3', isolation_level=None)
    other.execute('CREATE TABLE begun (number INTEGER)')
    # SQLite refuses at once to change the mode while there is a writer
    other.execute('BEGIN IMMEDIATE')
    with ThreadPoolExecutor(1) as pool:
        made = pool.submit(Catalogue, tmp_path, create=True)
        time.sleep(0.3)
        assert not made.done()
        other.execute('COMMIT')
        made.result(10.0).add_scan('s1', 'part', '', 'DONE', {})
    other.close()


def test_catalogue_that_stays_locked_is_busy_and_not_broken(tmp_path):
    other = sqlite3.connect(tmp_path / 'catalogue.sqlite3', isolation_level=None)
    other.execute('CREATE TABLE begun (number INTEGER)')
    other.execute('BEGIN IMMEDIATE')
    start = time.monotonic()
    with pytest.raises(CatalogueBusyError, match='database is locked'):
        Catalogue(tmp_path, create=True, timeout_s=0.3)
    assert 0.2 < time.monotonic() - start < 5.0
    other.close()


def test_folder_of_the_scans_may_move(catalogue, tmp_path):
    catalogue.add_result('s1', str(catalogue.root / 's1' / 'again'), {})
    catalogue.close()
    catalogue.root.rename(tmp_path / 'elsewhere')
    moved = Catalogue(tmp_path / 'elsewhere')
    assert moved.scan('s1').folder == tmp_path / 'elsewhere' / 's1'
    assert moved.results('s1')[0].folder == tmp_path / 'elsewhere' / 's1' / 'again'


@pytest.mark.parametrize('url', ['mysql://host/x', 'nonsense', 'mysql://user:secret@host/x'])
def test_url_that_cannot_be_used_is_named_without_its_password(tmp_path, url):
    with pytest.raises(CatalogueError) as caught:
        Catalogue(tmp_path, url=url)
    assert 'secret' not in str(caught.value)
