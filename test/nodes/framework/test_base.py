# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node of the base and one with a lifecycle, as processes and by a plain client."""

import json
import signal
import time

from lifecycle_msgs.srv import ChangeState
from lifecycle_msgs.srv import GetState
import pytest
from rcl_interfaces.srv import DescribeParameters
from rcl_interfaces.srv import ListParameters
from std_msgs.msg import Header
from std_srvs.srv import Trigger
from support.graph_rig import NodeProcess
from support.graph_rig import running

PLAIN = """
import sys
from ivfmc_ros.errors import FileError
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.base import run
from std_msgs.msg import Header
import time

class Plain(CellNode):
    def __init__(self):
        super().__init__('plain')
        self.parameter('speed', 1.0, 'Any number.', low=0.0, high=2.0)
        self.parameter('checked', '', 'Text of which a faulty check or callback raises.')
        self.check(self.examine)
        self.changed(self.react)
        self.subscribe(Header, 'poke', self.poke)
        self.steady_timer(0.05, self.guarded(lambda: None, 'poke'))
        self.trigger('refuse', self.refuse)
        self.trigger('break', lambda: 1 / 0)
        self.trigger('wait', self.wait)
        self.trigger('top', lambda: {'here': True}, private=False)

    def examine(self, values):
        if values['checked'] == 'check':
            raise KeyError('examined')

    def react(self, names):
        if self.get('checked') == 'callback':
            raise ValueError('reacted')

    def poke(self, message):
        if message.frame_id == 'hard':
            raise ValueError('poked hard')

    def refuse(self):
        raise FileError('mesh.stl: exists already')

    async def wait(self):
        return {'slept': await self.in_thread(lambda: time.sleep(1.0) or 1.0)}

sys.exit(run(Plain))
"""

LIVING = """
import sys
from pathlib import Path
from ivfmc_ros.errors import DeviceError
from ivfmc_ros.nodes.framework.base import run
from ivfmc_ros.nodes.framework.lifecycle import LifecycleCellNode

class Living(LifecycleCellNode):
    def __init__(self):
        super().__init__('living')
        self.parameter('device', '', 'Path of a file that must exist.')

    def on_configure(self, state):
        if not Path(self.get('device')).exists():
            raise DeviceError('device: does not exist')

    def on_deactivate(self, state):
        raise ValueError('stuck')

sys.exit(run(Living))
"""


HANGING = """
import ctypes
import sys
from ivfmc_ros.nodes.framework import base
from ivfmc_ros.nodes.framework import shutdown

shutdown.SHUTDOWN_S = 1.0

class Hanging(base.CellNode):
    def __init__(self):
        super().__init__('plain')

    def stop(self):
        # holds the GIL, so that no other thread runs
        ctypes.PyDLL(None).sleep(60)

sys.exit(base.run(Hanging))
"""


def test_node_that_hangs_at_shutdown_is_killed(client, script):
    script(HANGING)
    node = NodeProcess('plain')
    client.until(lambda: client.diagnostic('plain'))
    begin = time.monotonic()
    assert node.end() == -signal.SIGALRM
    assert time.monotonic() - begin < 10.0


def test_responses_are_json_with_the_code_of_the_error(client, script):
    script(PLAIN)
    with running('plain'):
        assert client.trigger('plain/refuse') == (
            False,
            {'code': 'BAD_FILE', 'detail': 'mesh.stl: exists already'},
        )
        good, answer = client.trigger('plain/break')
        assert (good, answer['code']) == (False, 'INTERNAL')
        assert 'ZeroDivisionError' in answer['detail']
        assert client.trigger('top') == (True, {'code': 'OK', 'here': True})


def test_callback_that_raises_is_a_fault_until_it_succeeds_again(client, script):
    script(PLAIN)
    with running('plain'):
        poke = client.publisher(Header, 'poke')
        client.until(poke.get_subscription_count)
        poke.publish(Header(frame_id='hard'))
        client.until(lambda: 'poked hard' in client.diagnostic('plain'))
        poke.publish(Header(frame_id='soft'))
        client.until(lambda: 'poked hard' not in client.diagnostic('plain'))


def test_parameter_callback_that_raises_leaves_no_caller_without_an_answer(client, script):
    script(PLAIN)
    with running('plain'):
        refused = client.set('plain', checked='check')
        assert not refused.successful
        assert "KeyError: 'examined'" in refused.reason
        assert client.set('plain', checked='callback').successful
        client.until(lambda: 'ValueError: reacted' in client.diagnostic('plain'))
        assert client.set('plain', checked='fine').successful
        client.until(lambda: 'reacted' not in client.diagnostic('plain'))


def test_heartbeat_continues_while_a_service_waits(client, script):
    script(PLAIN)
    beats = []
    with running('plain'):
        client.node.create_subscription(
            Header, 'plain/heartbeat', lambda _: beats.append(time.monotonic()), 10
        )
        client.until(lambda: beats)
        requests = client.node.create_client(Trigger, 'plain/wait')
        client.until(requests.service_is_ready)
        before = len(beats)
        future = requests.call_async(Trigger.Request())
        client.until(future.done)
        assert json.loads(future.result().message) == {'code': 'OK', 'slept': 1.0}
        # published at 6.7 Hz; the interface promises 5 Hz
        assert len(beats) - before >= 5


def test_node_that_is_alone_does_not_receive_its_own_heartbeat(client, script):
    script(PLAIN)
    with running('plain'):
        assert client.trigger('top')[0]
        # every heartbeat would wake the node twice
        client.until(lambda: client.node.count_subscribers('plain/heartbeat') == 0)


def test_second_node_of_a_name_refuses_and_answers_nothing(client, script):
    script(PLAIN)
    first = NodeProcess('plain')
    try:
        assert client.trigger('top')[0]
        second = NodeProcess('plain')
        try:
            second.process.wait(60)
        finally:
            code = second.end()
        assert code == 2, second.output
        assert 'a node /ivfmc/plain runs already' in second.output
        # the diagnostics of the second are not those of the first
        client.spin(0.0)
        assert 'ended' not in client.diagnostic('plain')
        assert first.alive
    finally:
        first.end(signal.SIGKILL)
    # a dead node stays in the graph for a while, and makes no other refuse
    beats = client.collect(Header, 'plain/heartbeat')
    with running('plain'):
        client.until(lambda: beats and float(beats[-1].frame_id.split('/')[2]) > 3.5)


def test_last_act_of_a_node_is_the_reason_of_its_end(client, script):
    script(PLAIN)
    node = NodeProcess('plain')
    client.until(lambda: client.diagnostic('plain'))
    node.process.send_signal(signal.SIGTERM)
    client.until(lambda: 'ended: signal SIGTERM received' in client.diagnostic('plain'), 10.0)
    assert node.end() == 0


def test_invalid_parameter_of_the_command_line_is_rejected_by_name(script):
    script(PLAIN)
    node = NodeProcess('plain', speed=7.0)
    node.process.wait(60)
    assert node.end() == 2
    assert 'parameter speed' in node.output


def test_unknown_parameter_is_named_with_the_similar_one(client, script):
    script(PLAIN)
    node = NodeProcess('plain', sped=1.0, other__thing=2.0)
    client.until(lambda: client.node.count_publishers('plain/heartbeat'), 20.0)
    assert node.end() == 0
    assert "parameter 'sped' is unknown to plain; did you mean 'speed'?" in node.output
    assert "parameter 'other.thing' is unknown to plain" in node.output


def test_device_that_appears_late_is_activated(client, script, tmp_path):
    script(LIVING)
    device = tmp_path / 'device'
    with running('living', device=str(device)):
        client.until(lambda: 'device: does not exist' in client.diagnostic('living'))
        device.touch()
        client.until(lambda: state(client) == 'active')
        client.until(lambda: 'device: does not exist' not in client.diagnostic('living'))


def test_no_lifecycle_transition_ends_a_node(client, script, tmp_path):
    script(LIVING)
    device = tmp_path / 'device'
    device.touch()
    with running('living', device=str(device)):
        client.until(lambda: state(client) == 'active')
        assert not change(client, 'configure')
        assert not change(client, 'fly')
        assert state(client) == 'active'
        # the exception is reported, and the node can be configured again
        assert not change(client, 'deactivate')
        client.until(lambda: 'ValueError: stuck' in client.diagnostic('living'))
        assert state(client) == 'unconfigured'
        assert change(client, 'configure')
        assert change(client, 'activate')


def state(client):
    return client.call(GetState, 'living/get_state', GetState.Request()).current_state.label


def change(client, label):
    ids = {'configure': 1, 'activate': 3, 'deactivate': 4, 'fly': 99}
    request = ChangeState.Request()
    request.transition.id = ids[label]
    return client.call(ChangeState, 'living/change_state', request).success


@pytest.mark.parametrize('name', ['triangulator', 'registrar', 'mesher'])
def test_every_parameter_has_a_description_and_every_number_a_range_or_constraint(client, name):
    with running(name):
        listed = client.call(ListParameters, f'{name}/list_parameters', ListParameters.Request())
        request = DescribeParameters.Request(names=listed.result.names)
        answer = client.call(DescribeParameters, f'{name}/describe_parameters', request)
    ours = [
        d
        for d in answer.descriptors
        if d.name not in ('use_sim_time', 'start_type_description_service')
    ]
    assert ours
    assert [d.name for d in ours if not d.description] == []
    numbers = [d for d in ours if d.type in (2, 3)]
    ranged = [
        d.floating_point_range or d.integer_range or d.additional_constraints for d in numbers
    ]
    assert all(ranged)
