# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Cells of one namespace on one computer, with clients that hear no heartbeat."""

from contextlib import nullcontext
from types import SimpleNamespace

import pytest

from ivfmc_ros.cli.support import sole_cell as module
from ivfmc_ros.cli.support.sole_cell import sole_cell
from ivfmc_ros.errors import HelperError


@pytest.fixture(autouse=True)
def brief(monkeypatch):
    monkeypatch.setattr(module, '_LISTEN_S', 0.0)
    # of no cell that runs beside the test
    monkeypatch.setenv('ROS_DOMAIN_ID', '231')


def client(namespace, beating=()):
    return SimpleNamespace(
        namespace=namespace,
        heartbeats=lambda: nullcontext(lambda: set(beating)),
        spin=lambda seconds: None,
    )


# 150 letters do not fit the name of a socket
@pytest.mark.parametrize('namespace', ['/ivfmc', '/' + 150 * 'a'])
def test_second_cell_of_a_namespace_is_refused_until_the_first_ends(namespace):
    with sole_cell(client(namespace)):
        with sole_cell(client('/other')):
            pass
        refused = pytest.raises(HelperError, match=f'up in {namespace} already')
        with refused, sole_cell(client(namespace)):
            pass
    with sole_cell(client(namespace)):
        pass


def test_cell_of_another_computer_is_known_by_its_heartbeats():
    refused = pytest.raises(HelperError, match='already \\(mesher\\)')
    with refused, sole_cell(client('/ivfmc', ['mesher'])):
        pass
