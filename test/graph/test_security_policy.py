# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The policy for SROS2 allows what a running cell does, and the beam to the orchestrator only."""

from pathlib import Path

import pytest
from support.cell_rig import Cell
from support.graph_endpoints import endpoints
from support.graph_endpoints import PUBLISH
from support.graph_endpoints import REPLY
from support.graph_endpoints import REQUEST
from support.graph_endpoints import SUBSCRIBE
from support.graph_rig import following_client
from support.graph_rig import NAMESPACE
from support.page_clients import page_clients
from support.scan_result import await_result
from support.security_policy import allowed
from support.small_cell import small_cell_options

from ivfmc_ros.cli.support.cell_run import NODES
from ivfmc_ros.cli.support.cell_run import WINDOW

POLICY = Path(__file__).resolve().parents[2] / 'config' / 'security' / 'policies.xml'
PORT = 8197
SCAN = {'motion': 'step', 'profiles': 6, 'lasers': ['left', 'right']}


@pytest.fixture(scope='module')
def policy():
    return allowed(POLICY)


def holders(policy, kind, name):
    """Nodes that may use an endpoint."""
    full = f'{NAMESPACE}/{name}'
    return {path.rpartition('/')[2] for path, rules in policy.items() if (kind, full) in rules}


def test_each_node_has_its_own_enclave(policy):
    assert set(policy) == {f'{NAMESPACE}/{name}' for name in (*NODES, WINDOW, 'client')}


def test_only_the_orchestrator_holds_the_beam(policy):
    assert holders(policy, PUBLISH, 'beam_hold') == {'orchestrator'}
    assert holders(policy, PUBLISH, 'joint_trajectory') == {'orchestrator', WINDOW}
    assert holders(policy, REQUEST, 'turntable/left/enable') == {WINDOW}
    assert holders(policy, PUBLISH, 'image_raw') == {'camera'}
    assert holders(policy, PUBLISH, 'profile') == {'triangulator'}


def test_what_is_received_is_sent_by_a_node_of_the_policy(policy):
    every = {rule for rules in policy.values() for rule in rules}
    # of the controller of a light curtain, a sensor, and a driver that compresses its pictures
    names = ('beam_permit', 'temperature', 'image_raw/compressed')
    foreign = {'/clock', *(f'{NAMESPACE}/{name}' for name in names)}
    for there, here in ((SUBSCRIBE, PUBLISH), (REQUEST, REPLY)):
        wanted = {name for kind, name in every if kind == there} - foreign
        assert wanted <= {name for kind, name in every if kind == here}


@pytest.mark.realtime
def test_a_scan_needs_no_more_than_the_policy_allows(policy, tmp_path):
    found = {}

    def look(client):
        for name, used in endpoints(client.node).items():
            found.setdefault(name, set()).update(used)

    with following_client() as client:
        cell = Cell(
            tmp_path, *small_cell_options(tmp_path), '--window', '--set', f'window.port={PORT}'
        )
        try:
            client.until(lambda: client.status, 90.0, 'no cell')
            client.until(lambda: 'serving' in client.diagnostic(WINDOW), 60.0, 'no window')
            with page_clients(PORT, 1):
                assert client.set('orchestrator', **SCAN).successful
                success, answer = client.trigger('start_scan')
                assert success, answer

                await_result(client, answer['scan_id'], 120.0, lambda: look(client))
            assert client.status[-1].message == 'DONE'
        finally:
            cell.kill()
    assert found.keys() >= {*NODES, WINDOW}
    # the number in its name is that of the process
    [up] = found.keys() - {*NODES, WINDOW}
    known = {f'{NAMESPACE}/{name}': used for name, used in found.items() if name != up}
    known[f'{NAMESPACE}/client'] = {
        (kind, name.replace(f'/{up}/', '/client_*/')) for kind, name in found[up]
    }
    refused = {path: sorted(used - policy[path]) for path, used in known.items()}
    assert not any(refused.values()), refused
