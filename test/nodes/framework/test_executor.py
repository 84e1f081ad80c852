# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The executor of a node calls what rclpy's own would call."""

from functools import partial
import threading
import time

import pytest
import rclpy
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock
from rclpy.clock import ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.task import Future
from std_msgs.msg import Header
from std_srvs.srv import Trigger
from support.graph_rig import DOMAIN
from support.graph_rig import node_environment

from ivfmc_ros.nodes.framework import executor as executor_module
from ivfmc_ros.nodes.framework import qos
from ivfmc_ros.nodes.framework.executor import NodeExecutor
from ivfmc_ros.nodes.framework.thread_work import start_thread

_PATIENCE_S = 20.0


class Rig:
    """A node in an executor."""

    def __init__(self, context):
        self.context = context
        self.executor = NodeExecutor(context=context)
        self.node = rclpy.create_node('spun', context=context)
        self.executor.add_node(self.node)
        self.clock = Clock(clock_type=ClockType.STEADY_TIME)

    def until(self, condition):
        deadline = time.monotonic() + _PATIENCE_S
        while not condition():
            assert time.monotonic() < deadline
            self.executor.spin_once(timeout_sec=0.1)

    def rounds(self, count):
        for _ in range(count):
            self.executor.spin_once(timeout_sec=0.05)

    def timer(self, callback, period_s=0.01, **options):
        return self.node.create_timer(period_s, callback, clock=self.clock, **options)

    def subscribe(self, callback, topic='poke', **options):
        return self.node.create_subscription(Header, topic, callback, qos.reliable(10), **options)

    def publisher(self, topic='poke'):
        return self.node.create_publisher(Header, topic, qos.reliable(10))

    def call(self, name):
        client = self.node.create_client(Trigger, name, callback_group=ReentrantCallbackGroup())
        self.until(client.service_is_ready)
        return client.call_async(Trigger.Request())


@pytest.fixture
def rig(monkeypatch):
    for name, value in node_environment().items():
        monkeypatch.setenv(name, value)
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=DOMAIN)
    rig = Rig(context)
    yield rig
    rig.executor.shutdown()
    rig.node.destroy_node()
    rclpy.try_shutdown(context=context)


def test_timers_are_called_at_their_periods(rig):
    calls, begin = [], time.monotonic()
    rig.timer(lambda: calls.append('fast'), 0.02)
    rig.timer(lambda: calls.append('slow'), 0.2)
    rig.until(lambda: calls.count('slow') == 2)
    assert time.monotonic() - begin >= 0.38
    assert calls.count('fast') >= 10


def test_canceled_timer_rests_until_it_is_reset(rig):
    calls = []
    timer = rig.timer(lambda: calls.append(timer.cancel()))
    rig.until(lambda: calls)
    rig.rounds(5)
    assert len(calls) == 1
    timer.reset()
    rig.until(lambda: len(calls) == 2)


def test_timer_with_another_period_is_called_by_that(rig):
    calls = []
    timer = rig.timer(lambda: calls.append(0), 60.0)
    rig.rounds(1)
    timer.timer_period_ns = 10_000_000
    timer.reset()
    rig.until(lambda: len(calls) > 3)


def test_messages_reach_subscriptions_of_every_form(rig):
    whole, raw, informed = [], [], []
    rig.subscribe(whole.append)
    rig.subscribe(raw.append, raw=True)
    rig.subscribe(lambda message, info: informed.append((message, info)))
    publisher = rig.publisher()
    rig.until(lambda: publisher.get_subscription_count() == 3)
    for number in range(3):
        publisher.publish(Header(frame_id=str(number)))
    rig.until(lambda: len(whole) == len(raw) == len(informed) == 3)
    assert [message.frame_id for message in whole] == ['0', '1', '2']
    assert isinstance(raw[0], bytes)
    assert informed[0][1]['source_timestamp'] > 0


def test_entities_come_and_go_while_the_node_spins(rig):
    got = []
    rig.rounds(2)
    subscription = rig.subscribe(got.append)
    publisher = rig.publisher()
    rig.until(lambda: publisher.get_subscription_count() == 1)
    publisher.publish(Header())
    rig.until(lambda: got)
    rig.node.destroy_subscription(subscription)
    rig.until(lambda: publisher.get_subscription_count() == 0)
    publisher.publish(Header())
    rig.rounds(3)
    assert len(got) == 1


def test_callbacks_destroy_each_other_in_one_round(rig):
    calls = []

    def call(own):
        calls.append(own)
        for name in [name for name in timers if name != own]:
            rig.node.destroy_timer(timers.pop(name))

    timers = {name: rig.timer(partial(call, name)) for name in ('first', 'second')}
    time.sleep(0.02)
    rig.rounds(4)
    assert len(set(calls)) == 1
    assert len(calls) >= 2


def test_service_that_awaits_blocks_neither_timers_nor_other_requests(rig):
    ticks, released = [], Future(executor=rig.executor)
    group = ReentrantCallbackGroup()

    async def wait(_, response):
        await released
        response.success = True
        return response

    rig.node.create_service(Trigger, 'wait', wait, callback_group=group)
    rig.node.create_service(Trigger, 'go', lambda _, response: response, callback_group=group)
    rig.timer(lambda: ticks.append(0))
    waiting = rig.call('wait')
    rig.until(lambda: len(ticks) > 10)
    answered = rig.call('go')
    rig.until(answered.done)
    assert not waiting.done()
    released.set_result(None)
    rig.until(waiting.done)
    assert waiting.result().success


def test_coroutine_holds_its_group_of_callbacks(rig):
    released, others, free = Future(executor=rig.executor), [], []
    group = MutuallyExclusiveCallbackGroup()
    entered = []

    async def hold():
        timer.cancel()
        entered.append(0)
        await released

    timer = rig.timer(hold, callback_group=group)
    rig.until(lambda: entered)
    rig.timer(lambda: others.append(0), callback_group=group)
    rig.timer(lambda: free.append(0))
    rig.until(lambda: len(free) > 5)
    assert not others
    released.set_result(None)
    rig.until(lambda: others)


def test_task_that_awaits_work_of_a_thread_is_resumed_at_once(rig):
    begun = threading.Event()

    async def work():
        return await start_thread(rig.executor, 'work', lambda: begun.wait(_PATIENCE_S))

    task = rig.executor.create_task(work)
    rig.rounds(2)
    assert not task.done()
    begun.set()
    begin = time.monotonic()
    while not task.done():
        assert time.monotonic() - begin < _PATIENCE_S
        rig.executor.spin_once(timeout_sec=_PATIENCE_S)
    assert task.result() is True
    assert time.monotonic() - begin < 1.0


def test_task_that_awaits_another_is_resumed_in_the_same_round(rig):
    order = []

    async def first():
        order.append(await rig.executor.create_task(second))

    async def second():
        return 'second'

    task = rig.executor.create_task(first)
    begin = time.monotonic()
    while not task.done():
        rig.executor.spin_once(timeout_sec=1.0)
    assert order == ['second']
    assert time.monotonic() - begin < 0.9


@pytest.mark.parametrize('of', ['timer', 'subscription', 'task'])
def test_exception_of_a_callback_is_raised_and_the_rest_goes_on(rig, of):
    calls = []

    def fail(*_):
        calls.append('failed')
        raise ValueError('in a callback')

    if of == 'timer':
        timer = rig.timer(lambda: (timer.cancel(), fail()))
    elif of == 'subscription':
        rig.subscribe(fail)
        publisher = rig.publisher()
        rig.until(lambda: publisher.get_subscription_count() == 1)
        publisher.publish(Header())
    else:
        rig.executor.create_task(fail)
    with pytest.raises(ValueError, match='in a callback'):
        rig.until(lambda: False)
    rig.timer(lambda: calls.append('ticked'))
    rig.until(lambda: 'ticked' in calls)
    assert calls.count('failed') == 1


def test_entities_are_collected_only_when_they_change(rig, monkeypatch):
    collected, ticks = [], []

    class Counted(executor_module._Entities):
        def __init__(self, *arguments):
            collected.append(0)
            super().__init__(*arguments)

    monkeypatch.setattr(executor_module, '_Entities', Counted)
    rig.timer(lambda: ticks.append(0))
    rig.until(lambda: len(ticks) > 20)
    assert len(collected) == 1
    rig.subscribe(lambda _: None)
    rig.until(lambda: len(ticks) > 40)
    assert len(collected) == 2


def test_end_of_the_context_is_raised(rig):
    rig.rounds(1)
    rclpy.shutdown(context=rig.context)
    with pytest.raises(ExternalShutdownException):
        rig.executor.spin_once(timeout_sec=1.0)


def test_nothing_is_called_after_shutdown(rig):
    calls = []
    rig.timer(lambda: calls.append(0))
    rig.until(lambda: calls)
    count = len(calls)
    rig.executor.shutdown()
    time.sleep(0.02)
    rig.executor.spin_once(timeout_sec=0.0)
    assert len(calls) == count
