# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from types import SimpleNamespace

import pytest

from ivfmc_ros.errors import HelperError
from ivfmc_ros.nodes.scanning import table_motion
from ivfmc_ros.scan.motion_check import MotionCheck
from ivfmc_ros.scan.plan import MotionLimits
from ivfmc_ros.scan.table_reports import TableReports

TARGET = 0.5


class Table:
    """A table that stands at 0 and reports 50 times a second; the first commands are lost."""

    def __init__(self, monkeypatch, *, loses, lost):
        self.now, self.position = 100.0, 0.0
        self.table, self.commands = TableReports(), 0
        self._loses, self._lost = loses, lost
        self.diagnostics = SimpleNamespace(controller_message='')
        monkeypatch.setattr(
            table_motion,
            'MotionCheck',
            lambda **values: MotionCheck(clock=lambda: self.now, **values),
        )

    def may_lose_commands(self):
        return self._loses

    def command(self, position, seconds):
        self.table.begin_move()
        self.commands += 1

    def hold(self, laser):
        pass

    def move(self, seconds=4.0):
        motion = table_motion.TableMotion(self, MotionLimits(), 2e-3, TARGET, 1.0)
        motion.command()
        for _ in range(round(seconds / 0.02)):
            self.now += 0.02
            if self.commands > self._lost:
                self.position = min(self.position + 0.02, TARGET)
            self.table.add(round(self.now * 1e9), self.position, None)
            if motion.has_arrived():
                return
        pytest.fail('neither arrived nor refused')


@pytest.mark.parametrize('lost', [0, 1, 2])
def test_command_that_a_best_effort_driver_lost_is_repeated(monkeypatch, lost):
    table = Table(monkeypatch, loses=True, lost=lost)
    table.move()
    assert table.commands == lost + 1


def test_command_to_a_reliable_driver_is_sent_once(monkeypatch):
    table = Table(monkeypatch, loses=False, lost=1)
    with pytest.raises(HelperError, match=r'stands at 0\.00 degrees'):
        table.move()
    assert table.commands == 1


def test_table_that_takes_no_command_is_refused(monkeypatch):
    table = Table(monkeypatch, loses=True, lost=99)
    with pytest.raises(HelperError, match=r'stands at 0\.00 degrees'):
        table.move()
