# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import http.client

import numpy as np
import pytest
from support.graph_rig import following_client
from support.graph_rig import NodeProcess
from support.graph_rig import running

from ivfmc_ros.errors import MessageError
from ivfmc_ros.nodes.convert import meshes
from ivfmc_ros.simulation.parts.solids import demo_part


def status(port, **headers):
    connection = http.client.HTTPConnection('127.0.0.1', port, timeout=5)
    try:
        connection.request('GET', '/', headers=headers)
        return connection.getresponse().status
    finally:
        connection.close()


def port_of(client):
    found = {}
    # those of a window before, its last words included
    client.spin(0.5)
    client.forget('window')

    def known():
        for part in client.diagnostic('window').split(' | '):
            name, _, text = part.partition(': ')
            found[name] = text
        return found.get('port', '').isdigit()

    client.until(known, 20.0, 'no port')
    return int(found['port'])


@pytest.fixture(scope='module')
def client():
    with following_client() as client:
        yield client


def test_page_is_served_to_this_computer_only(client, cell_file, tmp_path):
    with running('window', cell=str(cell_file), port=0, scan_root=str(tmp_path)):
        port = port_of(client)
        assert status(port) == 200
        assert status(port, Origin='http://evil.example') == 403
        client.until(lambda: 'refused: 1' in client.diagnostic('window'), 5.0)


def test_other_address_needs_a_token(client, cell_file, tmp_path):
    refused = NodeProcess('window', cell=str(cell_file), port=0, address='0.0.0.0')
    refused.process.wait(60)
    assert refused.end() == 2
    assert 'address 0.0.0.0: other computers can reach it; name a token_file' in refused.output
    token = tmp_path / 'token'
    token.write_text('0123456789abcdef\n')
    files = {'token_file': str(token), 'scan_root': str(tmp_path)}
    with running('window', cell=str(cell_file), port=0, address='0.0.0.0', **files):
        port = port_of(client)
        assert status(port) == 401
        assert status(port, Cookie='ivfmc_window=0123456789abcdef') == 200


def test_mesh_message_is_read_as_it_was_written():
    solid = demo_part()
    vertices, faces = meshes.from_mesh_shape(meshes.mesh_shape(solid.vertices_xyz, solid.faces))
    np.testing.assert_array_equal(vertices, solid.vertices_xyz)
    np.testing.assert_array_equal(faces, solid.faces)
    for size in (3, 40, 4000):
        with pytest.raises(MessageError, match='mesh_shape'):
            meshes.from_mesh_shape(meshes.mesh_shape(solid.vertices_xyz, solid.faces)[:size])


def test_empty_mesh_message_is_an_empty_mesh():
    empty = meshes.mesh_shape(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
    vertices, faces = meshes.from_mesh_shape(empty)
    assert (len(vertices), len(faces)) == (0, 0)
