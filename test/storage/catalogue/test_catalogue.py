# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from concurrent.futures import ThreadPoolExecutor
import sqlite3
import time

import pytest

from ivfmc_ros.errors import CatalogueError
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.catalogue.catalogue import FILE_NAME
from ivfmc_ros.storage.messages.profile_header import ProfileHeader
from ivfmc_ros.storage.recording.live_recorder import ProfileLocation


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


def test_profile_cannot_be_written_twice(catalogue):
    catalogue.add_profiles('s1', [location(0)])
    with pytest.raises(CatalogueError, match='UNIQUE'):
        catalogue.add_profiles('s1', [location(0)])


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
