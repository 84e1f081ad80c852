# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import sqlite3
import time

import pytest

from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.catalogue.catalogue import FILE_NAME
from ivfmc_ros.storage.catalogue.catalogue_writer import CatalogueWriter


@pytest.fixture
def writer(tmp_path):
    catalogue = Catalogue(tmp_path, create=True, timeout_s=0.5)
    catalogue.add_scan('s1', 'part', '', 'IDLE', {})
    return CatalogueWriter(catalogue)


@pytest.fixture
def lock(tmp_path, writer):
    """Exclusive lock of another program."""
    connection = sqlite3.connect(tmp_path / FILE_NAME)
    connection.execute('BEGIN EXCLUSIVE')
    yield connection
    connection.close()


def until(condition):
    deadline = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_updates_wait_for_a_locked_catalogue_and_keep_their_order(writer, lock, tmp_path):
    begin = time.monotonic()
    writer.add(lambda catalogue: catalogue.set_stage('s1', 'SCANNING'))
    writer.add(lambda catalogue: catalogue.set_stage('s1', 'DONE'))
    assert time.monotonic() - begin < 0.4
    until(lambda: 'locked' in writer.error)
    lock.rollback()
    until(lambda: not writer.error)
    writer.close()
    assert Catalogue(tmp_path).scan('s1').stage == 'DONE'


def test_update_that_fails_is_reported_and_blocks_no_other(writer, tmp_path):
    writer.add(lambda catalogue: catalogue.set_stage('s2', 'SCANNING'))
    writer.add(lambda catalogue: catalogue.set_stage('s1', 'DONE'))
    writer.close()
    assert "has no scan 's2'" in writer.error
    assert Catalogue(tmp_path).scan('s1').stage == 'DONE'


def test_close_does_not_wait_for_a_lock_without_limit(writer, lock):
    writer.add(lambda catalogue: catalogue.set_stage('s1', 'DONE'))
    writer.close()
    assert 'locked' in writer.error


def test_rows_follow_after_close_when_the_database_is_back(writer, lock, tmp_path):
    writer.add(lambda catalogue: catalogue.set_stage('s1', 'DONE'))
    writer.close()
    assert not writer.is_done
    lock.rollback()
    until(lambda: writer.is_done)
    assert not writer.error
    assert Catalogue(tmp_path).scan('s1').stage == 'DONE'
