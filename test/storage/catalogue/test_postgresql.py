# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The catalogue in a PostgreSQL server that is started here."""

from concurrent.futures import ThreadPoolExecutor
import json
import time

from click.testing import CliRunner
import pytest
from support import postgres
from support.recordings import write_profiles
from support.synthetic import small_cell

from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.cli.scans import scans
from ivfmc_ros.errors import CatalogueBusyError
from ivfmc_ros.errors import CatalogueError
from ivfmc_ros.storage.archive.rebuild import rebuild_scan
from ivfmc_ros.storage.catalogue.calibrations import add_calibration
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.catalogue.catalogue_writer import CatalogueWriter
from ivfmc_ros.storage.catalogue.inspections import add_inspection
from ivfmc_ros.storage.catalogue.schema import METADATA
from ivfmc_ros.storage.catalogue.search import ScanFilter
from ivfmc_ros.storage.messages.profile_header import ProfileHeader
from ivfmc_ros.storage.recording.profile_location import ProfileLocation

CELLS = 12
PROFILES = 10


def location(seq):
    header = ProfileHeader(seq=seq, view=0, laser=0, angle=0.1 * seq, points=5, stamp_ns=seq)
    return ProfileLocation(header=header, topic='/p', index=seq, log_time_ns=seq, chunk_offset=8)


@pytest.fixture(scope='module')
def server():
    pytest.importorskip('psycopg', reason='the driver of PostgreSQL (psycopg) is not installed')
    if postgres.programs() is None:
        pytest.skip('no PostgreSQL server on this machine: install the package postgresql')
    with postgres.running_server() as running:
        yield running


@pytest.fixture
def catalogue(server, tmp_path):
    made = Catalogue(tmp_path / '{cell}', create=True, url=server.url, cell='a')
    yield made
    with made.database.write() as connection:
        for table in reversed(METADATA.sorted_tables):
            connection.execute(table.delete())
    made.close()


def test_tables_are_those_of_the_migrations(catalogue):
    from alembic.autogenerate import compare_metadata
    from alembic.migration import MigrationContext

    with catalogue.database.read() as connection:
        assert compare_metadata(MigrationContext.configure(connection), METADATA) == []


def test_scan_is_written_and_found(catalogue, tmp_path):
    catalogue.add_scan('s1', 'bracket', 'fine', 'SCANNING', {'views': 2})
    catalogue.add_profiles('s1', [location(0), location(1)])
    catalogue.add_profiles('s1', [location(1), location(2)])
    catalogue.set_stage('s1', 'DONE', 'OK')
    catalogue.add_result('s1', 's1', {'faces': 12})
    report = tmp_path / 'report.json'
    item = {
        'feature': 'hole 3',
        'characteristic': 'diameter',
        'nominal_m': 0.01,
        'measured_m': 0.01001,
        'U_m': None,
        'tolerance_m': 5e-5,
        'verdict': 'pass',
    }
    report.write_text(json.dumps({'verdict': 'pass', 'characteristics': [item]}))
    assert add_inspection(catalogue, 's1', report)
    assert not add_inspection(catalogue, 's1', report)
    [found] = catalogue.find(ScanFilter(part='bracket', verdict='pass', feature='hole 3'))
    assert (found.cell, found.views, found.profiles, found.value.measured) == ('a', 1, 3, 0.01001)
    assert [row.seq for row in catalogue.profiles('s1')] == [0, 1, 2]
    save_cell(tmp_path / 'cell.yaml', small_cell())
    for _ in range(2):
        assert add_calibration(catalogue, 's1', tmp_path)
    digest = catalogue.scan('s1').calibration
    assert [row.scan_id for row in catalogue.find(ScanFilter(calibration=digest[:9]))] == ['s1']
    assert catalogue.scan('s1').folder == tmp_path / 'a' / 's1'
    assert catalogue.results('s1')[0].folder == tmp_path / 'a' / 's1'


def test_cells_may_have_scans_of_one_id(catalogue, server, tmp_path):
    catalogue.add_scan('s1', 'bracket', '', 'DONE', {})
    other = Catalogue(tmp_path / '{cell}', create=True, url=server.url, cell='b')
    other.add_scan('s1', 'flange', '', 'DONE', {})
    assert (catalogue.scan('s1').part, other.scan('s1').part) == ('bracket', 'flange')
    assert catalogue.scan('b/s1').folder == tmp_path / 'b' / 's1'
    third = Catalogue(tmp_path, url=server.url, cell='c')
    with pytest.raises(CatalogueError, match='several cells have it: a/s1, b/s1'):
        third.scan('s1')
    for made in (other, third):
        made.close()


@pytest.fixture
def archive(catalogue, server, tmp_path):
    """Folders of two cells with a scan of one id, the second without its last profiles."""
    root = tmp_path / '{cell}' / 'scans'
    for cell, count in (('a', 6), ('b', 4)):
        folder = tmp_path / cell / 'scans' / 's1'
        write_profiles(folder, range(count), per_chunk=2)
        made = Catalogue(root, create=True, url=server.url, cell=cell)
        rebuild_scan(made, folder)
        if cell == 'b':
            # the catalogue knows of them
            made.add_profiles('b/s1', [location(4), location(5)])
        made.close()
    return root


@pytest.fixture
def command(archive, server):
    """Run ``ivfmc scans`` on a machine that has the scans of all cells, and is none of them."""

    def run(*words):
        options = ['--scans', str(archive), '--catalogue', server.url]
        return CliRunner().invoke(scans, [*words, *options])

    return run


def test_scans_of_all_cells_are_verified_each_with_its_own_rows(command, archive):
    answer = command('verify', '--json')
    assert answer.exit_code == 3
    first, second = json.loads(answer.stdout)
    assert first['path'].endswith('/a/scans/s1')
    assert (first['sound'], first['complete']) == (True, True)
    assert second['path'].endswith('/b/scans/s1')
    [run] = second['missing']
    assert (run['first_seq'], run['last_seq']) == (4, 5)


def test_repaired_scan_keeps_its_cell(command, archive, tmp_path, catalogue):
    file = tmp_path / 'b' / 'scans' / 's1' / 'scan.mcap'
    file.write_bytes(file.read_bytes()[:-50])
    for source in ('b/s1', str(file.parent)):
        answer = command('repair', source)
        assert answer.exit_code == 0, answer.exception
    found = catalogue.find(ScanFilter())
    assert [(scan.cell, scan.scan_id, scan.profiles) for scan in found] == [
        ('a', 's1', 6),
        ('b', 's1', 4),
    ]


def test_scans_of_all_cells_are_rebuilt(command, archive, tmp_path, catalogue):
    with catalogue.database.write() as connection:
        for table in reversed(METADATA.sorted_tables):
            connection.execute(table.delete())
    for _ in range(2):
        assert command('rebuild').exit_code == 0
    found = sorted(
        (scan.cell, scan.scan_id, scan.profiles) for scan in catalogue.find(ScanFilter())
    )
    assert found == [('a', 's1', 6), ('b', 's1', 4)]
    assert not (tmp_path / '{cell}').exists()


def test_cells_write_at_once_and_nothing_is_lost(catalogue, server, tmp_path):
    def write(number):
        cell = Catalogue(tmp_path, url=server.url, cell=f'cell{number}')
        cell.add_scan('s1', 'bracket', '', 'SCANNING', {})
        for seq in range(PROFILES):
            cell.add_profiles('s1', [location(seq)])
        cell.set_stage('s1', 'DONE', 'OK')
        cell.close()

    with ThreadPoolExecutor(CELLS) as pool:
        list(pool.map(write, range(CELLS)))
    found = catalogue.find(ScanFilter(code='OK'))
    assert len({scan.cell for scan in found}) == CELLS
    assert {scan.profiles for scan in found} == {PROFILES}


def test_rows_follow_when_the_database_is_back(catalogue, server):
    catalogue.add_scan('s1', 'bracket', '', 'SCANNING', {})
    writer = CatalogueWriter(Catalogue(catalogue.root, url=server.url, cell='a'))
    writer.add(lambda target: target.add_profiles('s1', [location(0)]))
    server.stop()
    begin = time.monotonic()
    for seq in range(1, 4):
        writer.add(lambda target, seq=seq: target.add_profiles('s1', [location(seq)]))
    assert time.monotonic() - begin < 0.5
    writer.close()
    assert not writer.is_done
    assert writer.error
    with pytest.raises(CatalogueBusyError):
        Catalogue(catalogue.root, url=server.url, cell='a')
    server.start()
    deadline = time.monotonic() + 60.0
    while not writer.is_done and time.monotonic() < deadline:
        time.sleep(0.1)
    assert writer.is_done
    assert not writer.error
    assert [row.seq for row in catalogue.profiles('s1')] == [0, 1, 2, 3]


def test_database_without_a_catalogue_is_named(server, tmp_path):
    import psycopg

    with psycopg.connect(server.url.replace('+psycopg', ''), autocommit=True) as connection:
        connection.execute('CREATE DATABASE empty')
    with pytest.raises(CatalogueError, match='has no catalogue'):
        Catalogue(tmp_path, url=server.url.replace('/postgres', '/empty'))


def test_password_is_in_no_message(server, tmp_path):
    url = f'postgresql+psycopg://nobody:secret@127.0.0.1:{server.port}/postgres'
    with pytest.raises(CatalogueError) as caught:
        Catalogue(tmp_path, url=url)
    assert 'secret' not in str(caught.value)
