# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import pytest

from ivfmc_ros import stopwatch
from ivfmc_ros.stopwatch import Stopwatch


@pytest.fixture
def clock(monkeypatch):
    """Return a list whose only element is the time of the mocked clock."""
    now = [100.0]
    monkeypatch.setattr(stopwatch.time, 'perf_counter', lambda: now[0])
    return now


def test_stages_add_up_in_the_order_they_began(clock):
    watch = Stopwatch()
    with watch.stage('read'):
        clock[0] += 1.0
        with watch.stage('decode'):
            clock[0] += 2.0
    with watch.stage('mesh'):
        pass
    with watch.stage('read'):
        clock[0] += 4.0
    assert list(watch.seconds.items()) == [('read', 7.0), ('decode', 2.0), ('mesh', 0.0)]


def test_stage_that_fails_is_timed_and_fails(clock):
    watch = Stopwatch()

    def fail():
        with watch.stage('read'):
            clock[0] += 3.0
            raise KeyError('no')

    with pytest.raises(KeyError, match='no'):
        fail()
    assert watch.seconds == {'read': 3.0}


def test_only_the_iterator_is_timed(clock):
    def slow():
        for item in 'ab':
            clock[0] += 1.0
            yield item
        clock[0] += 0.5

    watch = Stopwatch()
    items = []
    for item in watch.each('read', slow()):
        clock[0] += 10.0
        items.append(item)
    assert items == ['a', 'b']
    assert watch.seconds == {'read': 2.5}


def test_error_of_the_iterator_is_raised(clock):
    def broken():
        yield 1
        raise OSError('cut')

    watch = Stopwatch()
    with pytest.raises(OSError, match='cut'):
        list(watch.each('read', broken()))
    assert 'read' in watch.seconds


def test_seconds_are_a_copy():
    watch = Stopwatch()
    watch.seconds['x'] = 1.0
    assert watch.seconds == {}
