# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import json
import signal

from diagnostic_msgs.msg import DiagnosticStatus
import pytest
from support.graph_rig import NodeProcess

from ivfmc_ros.scan import scan_folder
from ivfmc_ros.storage.catalogue.catalogue import Catalogue


@pytest.fixture
def root(tmp_path):
    """Folder of two scans that have not ended, and before them one without a catalogue row."""
    catalogue = Catalogue(tmp_path / 'scans', create=True)
    (catalogue.root / 'a_without_row').mkdir()
    scan_folder.save_job(catalogue.root / 'a_without_row', {'stage': 'SCANNING'})
    for name in ('cut_off', 'running'):
        catalogue.add_scan(name, 'part', '', 'SCANNING', {})
        (catalogue.root / name).mkdir()
        scan_folder.save_job(catalogue.root / name, {'stage': 'SCANNING'})
    return catalogue.root


def test_interrupted_scan_is_marked_and_a_running_one_is_not(client, cell_file, root):
    status = client.collect(DiagnosticStatus, 'scan_status')
    with scan_folder.lock_scan(root / 'running'):
        node = NodeProcess('orchestrator', cell=str(cell_file), scan_root=str(root))
        try:
            client.until(lambda: status, what='no scan_status')
        finally:
            node.end()
    # a client that waits for its end gets it from the new process
    values = {item.key: item.value for item in status[-1].values}
    assert (values['scan_id'], values['stage']) == ('cut_off', 'FAILED')
    assert json.loads(values['result'])['code'] == values['code'] == 'INTERRUPTED'
    catalogue = Catalogue(root)
    assert catalogue.scan('cut_off').code == 'INTERRUPTED'
    assert scan_folder.load_job(root / 'cut_off')['stage'] == 'FAILED'
    assert catalogue.scan('running').code == ''
    assert scan_folder.load_job(root / 'a_without_row')['stage'] == 'FAILED'
    assert scan_folder.load_job(root / 'running')['stage'] == 'SCANNING'


def test_scan_status_says_why_when_the_orchestrator_ends(client, cell_file, tmp_path):
    status = client.collect(DiagnosticStatus, 'scan_status')
    node = NodeProcess('orchestrator', cell=str(cell_file), scan_root=str(tmp_path / 'scans'))
    try:
        success, answer = client.trigger('start_scan')
        assert success, answer
        node.process.send_signal(signal.SIGTERM)
        client.until(
            lambda: any('signal SIGTERM received' in item.value for item in status[-1].values),
            10.0,
        )
        values = {item.key: item.value for item in status[-1].values}
        assert (values['stage'], values['code']) == ('FAILED', 'INTERRUPTED')
        assert values['scan_id'] == answer['scan_id']
    finally:
        node.end()
