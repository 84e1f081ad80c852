# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from types import SimpleNamespace

from ivfmc_ros.nodes.viewing.browser_timer import BrowserTimer


class FakeTimer:
    """A timer whose ticks the test makes."""

    def __init__(self, callback):
        self.callback, self.canceled = callback, False

    def tick(self):
        if not self.canceled:
            self.callback()

    def cancel(self):
        self.canceled = True

    def reset(self):
        self.canceled = False

    def is_canceled(self):
        return self.canceled


class Rig:
    """A node and a page with as many browsers as the test says."""

    def __init__(self):
        self.browsers, self.seen, self.tasks = 0, [], []
        self.executor = SimpleNamespace(create_task=self.tasks.append)
        self.timer = BrowserTimer(self, self, 0.1, self.seen.append)

    def steady_timer(self, period_s, callback):
        self.fake = FakeTimer(callback)
        return self.fake

    def on_browser(self, callback):
        self.connected = callback

    def come(self):
        self.browsers += 1
        self.connected()

    def run_tasks(self):
        while self.tasks:
            self.tasks.pop()()


def test_timer_rests_without_a_browser():
    rig = Rig()
    for _ in range(5):
        rig.fake.tick()
    assert rig.seen == [False]
    assert rig.timer.resting


def test_browser_wakes_it_and_the_last_one_that_leaves_ends_it():
    rig = Rig()
    rig.fake.tick()
    rig.come()
    # in a thread of the page nothing but a task for the executor
    assert rig.timer.resting
    rig.run_tasks()
    for _ in range(3):
        rig.fake.tick()
    rig.browsers = 0
    for _ in range(3):
        rig.fake.tick()
    assert rig.seen == [False, True, True, True, False]
    assert rig.timer.resting


def test_browser_that_comes_during_the_last_look_is_seen():
    rig = Rig()
    follow = rig.seen.append

    def come_within(has_browser):
        follow(has_browser)
        if not has_browser:
            rig.come()

    rig.timer._follow = come_within
    rig.fake.tick()
    rig.run_tasks()
    rig.fake.tick()
    assert rig.seen == [False, True]


def test_browser_that_is_faster_than_the_node_is_seen():
    rig = Rig()
    rig.executor = None
    rig.come()
    rig.fake.tick()
    assert rig.seen == [True]
    assert not rig.timer.resting
