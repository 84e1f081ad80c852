# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The history, with a server that no browser shows, and a person who is no browser either."""

from contextlib import closing
from types import SimpleNamespace

import pytest

from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.window.history_tab import HistoryTab
from ivfmc_ros.window.page import start_server

SCAN = '20261127T145851Z_bracket'


class Client:
    """Keeps what a browser gets."""

    def __init__(self):
        self.files, self.said = {}, []

    def send_file_download(self, name, content):
        self.files[name] = content

    def add_notification(self, title, body, **more):
        self.said.append(body)


@pytest.fixture
def person():
    return SimpleNamespace(client=Client())


@pytest.fixture
def tab(tmp_path):
    with closing(Catalogue(tmp_path, create=True)) as catalogue:
        catalogue.add_scan(SCAN, 'bracket', '', 'DONE', {})
    folder = tmp_path / SCAN
    folder.mkdir()
    (folder / 'mesh.stl').write_bytes(b'solid')
    (folder / '.hidden').write_bytes(b'')
    (tmp_path / 'secret').write_bytes(b'of no scan')
    server = start_server('test')
    tab = HistoryTab(server.gui, tmp_path, lambda mesh: None)
    tab.refresh()
    yield tab
    server.stop()


def test_files_of_the_chosen_scan_are_offered_and_sent(tab, person):
    tab._scan.value = SCAN
    assert tab._file.options == ('mesh.stl',)
    tab._send(person, tab._file.value)
    assert person.client.files == {f'{SCAN}_mesh.stl': b'solid'}


def test_report_of_scan_and_inspection_are_both_sent(tab, person, tmp_path):
    tab._scan.value = SCAN
    tab._send_reports(person)
    assert person.client.said == ['this scan has no such file']
    for name in ('report.html', 'inspection.html'):
        (tmp_path / SCAN / name).write_text('x')
    tab._send_reports(person)
    assert set(person.client.files) == {f'{SCAN}_report.html', f'{SCAN}_inspection.html'}


@pytest.mark.parametrize('name', ['../secret', '/etc/hostname', '.hidden', '', 'none.stl'])
def test_path_that_a_browser_names_is_not_read(tab, person, name):
    tab._scan.value = SCAN
    tab._send(person, name)
    assert person.client.files == {}
    assert person.client.said == ['this scan has no such file']


def test_scan_that_a_browser_names_is_one_of_the_catalogue(tab, person):
    # as a message of a browser sets it, which need not be one of the options
    tab._scan._impl.value = '..'
    tab._send(person, 'secret')
    assert person.client.files == {}
