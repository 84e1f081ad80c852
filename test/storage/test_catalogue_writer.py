# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import sqlite3
import time

import pytest

from ivfmc_ros.storage.catalogue import Catalogue
from ivfmc_ros.storage.catalogue import FILE_NAME
from ivfmc_ros.storage.catalogue_writer import Notes


@pytest.fixture
def notes(tmp_path):
    catalogue = Catalogue(tmp_path, create=True, patience_s=0.1)
    catalogue.add_scan('s1', 'part', '', 'IDLE', {})
    return Notes(catalogue)


@pytest.fixture
def lock(tmp_path, notes):
    """Somebody who looks into the catalogue with another program."""
    connection = sqlite3.connect(tmp_path / FILE_NAME)
    connection.execute('BEGIN EXCLUSIVE')
    yield connection
    connection.close()


def until(condition):
    deadline = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_notes_wait_for_a_catalogue_that_is_locked_and_come_in_order(notes, lock, tmp_path):
    begin = time.monotonic()
    notes.add(lambda catalogue: catalogue.set_stage('s1', 'SCANNING'))
    notes.add(lambda catalogue: catalogue.set_stage('s1', 'DONE'))
    assert time.monotonic() - begin < 0.1
    until(lambda: 'locked' in notes.error)
    lock.rollback()
    until(lambda: not notes.error)
    notes.close()
    assert Catalogue(tmp_path).scan('s1').stage == 'DONE'


def test_note_that_cannot_be_is_said_and_holds_up_no_other(notes, tmp_path):
    notes.add(lambda catalogue: catalogue.set_stage('s2', 'SCANNING'))
    notes.add(lambda catalogue: catalogue.set_stage('s1', 'DONE'))
    notes.close()
    assert "has no scan 's2'" in notes.error
    assert Catalogue(tmp_path).scan('s1').stage == 'DONE'


def test_end_does_not_wait_for_ever(notes, lock):
    notes.add(lambda catalogue: catalogue.set_stage('s1', 'DONE'))
    notes.close()
    assert 'locked' in notes.error
