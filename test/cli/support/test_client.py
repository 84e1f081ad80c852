# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The client of the scan service: parameters that hold for one scan only."""

import pytest

from ivfmc_ros.cli.support.client import CellClient
from ivfmc_ros.errors import HelperError

pytest.importorskip('rclpy')

from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import GetParameters
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter


class StubClient(CellClient):
    """A client of a node with two parameters, without a graph."""

    def __init__(self):
        self.values = {'part': 'part', 'profiles': 200}
        self.refuse = ''

    def call(self, name, kind, request, seconds):
        node, _, service = name.partition('/')
        assert node == 'orchestrator'
        if service == 'get_parameters':
            return GetParameters.Response(
                values=[
                    Parameter(name, value=self.values.get(name)).get_parameter_value()
                    for name in request.names
                ]
            )
        assert service == 'set_parameters_atomically'
        response = SetParametersAtomically.Response()
        wanted = {p.name: Parameter.from_parameter_msg(p).value for p in request.parameters}
        response.result.successful = self.refuse not in wanted
        response.result.reason = f'{self.refuse}: no'
        if response.result.successful:
            self.values.update(wanted)
        return response


def test_parameters_of_a_scan_are_restored():
    client = StubClient()
    with client.parameters('orchestrator', {'part': 'bracket', 'profiles': 60}):
        assert client.values == {'part': 'bracket', 'profiles': 60}
    assert client.values == {'part': 'part', 'profiles': 200}


def test_parameters_are_restored_when_the_scan_is_refused():
    client = StubClient()
    values = {'part': 'bracket'}
    with pytest.raises(HelperError, match='BUSY'), client.parameters('orchestrator', values):
        raise HelperError('BUSY', 'BUSY: a scan runs')
    assert client.values['part'] == 'part'


def test_a_refused_parameter_changes_none():
    client = StubClient()
    client.refuse = 'profiles'
    values = {'part': 'bracket', 'profiles': -1}
    with pytest.raises(HelperError, match='orchestrator: profiles: no') as caught:
        client.parameters('orchestrator', values).__enter__()
    assert caught.value.code == 'BAD_PARAMETER'
    assert client.values == {'part': 'part', 'profiles': 200}


def test_a_parameter_that_the_node_does_not_have_is_named():
    assert Parameter('x').get_parameter_value().type == ParameterType.PARAMETER_NOT_SET
    client = StubClient()
    with pytest.raises(HelperError, match='orchestrator: has no parameter speed'):
        client.parameters('orchestrator', {'speed': 1.0}).__enter__()
