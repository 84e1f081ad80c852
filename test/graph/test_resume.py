# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A scan goes on after a kill of the whole graph, and takes only what is missing."""

import pytest
from support import interrupted_cell
from support.interrupted_cell import kill_in_scan
from support.interrupted_cell import mesh_distance
from support.interrupted_cell import resume
from support.interrupted_cell import start_cell
from support.interrupted_cell import whole_scan

from ivfmc_ros.scan import scan_folder
from ivfmc_ros.storage.catalogue.catalogue import Catalogue


@pytest.fixture
def restarted(tmp_path):
    """Function that starts the cell of one folder; all its processes are killed at the end."""
    cells = []

    def start(client):
        cells.append(start_cell(client, tmp_path / 'cell'))
        return cells[-1]

    try:
        yield start
    finally:
        for cell in cells:
            cell.kill()


# in the first sweep, and in the second
@pytest.mark.slow
@pytest.mark.parametrize('profiles', [45, 105])
def test_scan_goes_on_after_a_kill_of_the_whole_graph(client, restarted, profiles):
    found = kill_in_scan(client, restarted(client), profiles)
    assert found.acknowledged <= len(found.stamps_ns)
    cell = restarted(client)
    status = interrupted_cell.values(client)
    assert (status['scan_id'], status['code']) == (found.scan_id, 'INTERRUPTED')
    # without an id it says which scan can be resumed
    success, answer = client.trigger('resume')
    assert (success, answer['code']) == (False, 'WRONG_STATE')
    assert found.scan_id in answer['detail']

    answer = resume(client, found.scan_id)
    assert answer['code'] == 'OK', answer
    assert answer['resumed'] is True
    folder = cell.scans / found.scan_id
    after = interrupted_cell.stamps_of(folder)
    # no profile is lost, and only those that were missing were taken
    assert found.stamps_ns.items() <= after.items()
    assert sorted(after) == list(range(len(after)))
    whole = whole_scan(client)
    assert whole['code'] == 'OK', whole
    views = answer['completeness']['views']
    assert [view['missing_deg'] for view in views] == [[], []]
    assert sum(len(view['retaken_as']) for view in views) == 1
    assert len(Catalogue(cell.scans).profiles(found.scan_id)) == len(after)
    assert Catalogue(cell.scans).scan(found.scan_id).stage == 'DONE'
    job = scan_folder.load_job(folder)
    assert (job['resumable'], job['course']['parts']) == (False, [0, len(found.stamps_ns)])
    # one sweep for what was missing of the interrupted one, which was not longer than that
    sweeps = job['course']['begun']
    assert [sweep['retake_of'] is None for sweep in sweeps] == [True, True, False]
    assert sweeps[2]['profiles'] <= sweeps[0]['profiles']

    assert answer['registration']['missing_profiles'] == 0
    assert mesh_distance(answer, whole) < 1e-4
    assert mesh_distance(whole, answer) < 1e-4
    # a sweep that was cut and taken again has more than one that was not
    assert answer['counts']['points'] > 0.7 * whole['counts']['points']
    # a scan that has ended is not resumed
    success, refused = client.trigger('resume')
    assert (success, refused['code']) == (False, 'RESUME_REFUSED')
    assert 'it is DONE' in refused['detail']


def test_scan_goes_on_after_a_kill_of_the_orchestrator_without_homing(client, restarted):
    cell = restarted(client)
    scan_id = interrupted_cell.kill_orchestrator(client, cell, 30)
    before = zero_of(client)
    answer = resume(client, scan_id)
    assert answer['code'] == 'OK', answer
    # the driver and its zero are those with which the scan began
    assert zero_of(client) == before
    assert [view['missing_deg'] for view in answer['completeness']['views']] == [[], []]
    after = interrupted_cell.stamps_of(cell.scans / scan_id)
    assert sorted(after) == list(range(len(after)))
    assert answer['registration']['missing_profiles'] == 0


def zero_of(client):
    values = dict(
        text.split(': ', 1)
        for text in client.diagnostic('turntable').split(' | ')[1:]
        if ': ' in text
    )
    return values['zero']
