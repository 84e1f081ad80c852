# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

import pytest

from ivfmc_ros.cli.support.processes import Processes
from ivfmc_ros.errors import HelperError

SLEEP = [
    sys.executable,
    '-c',
    'import time\nprint("up", flush=True)\ntime.sleep(60)',
]
STUBBORN = [
    sys.executable,
    '-c',
    'import signal, time\n'
    'for number in (signal.SIGINT, signal.SIGTERM): signal.signal(number, signal.SIG_IGN)\n'
    'print("up", flush=True)\ntime.sleep(60)',
]
# what mesher does: a child of a child
PARENT = [
    sys.executable,
    '-c',
    'import subprocess, sys, time\n'
    'child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])\n'
    'print(child.pid, flush=True)\nprint("up", flush=True)\ntime.sleep(60)',
]


def is_alive(pid):
    try:
        state = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0]
    except FileNotFoundError:
        return False
    return state != 'Z'


def wait_until(condition, seconds=10.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


class Said(list):
    def __call__(self, name, line):
        self.append((name, line))


def test_output_of_all_comes_to_one_place():
    said = Said()
    with Processes(said) as processes:
        processes.start('a', SLEEP, os.environ, ready='up')
        processes.start('b', SLEEP, os.environ, ready='up')
        ids = processes.ids
        assert all(is_alive(pid) for pid in ids.values())
    assert sorted(said) == [('a', 'up'), ('b', 'up')]
    assert not any(is_alive(pid) for pid in ids.values())


def test_log_that_cannot_be_written_blocks_no_process():
    def full(name, line):
        raise OSError('No space left on device')

    # more than a pipe holds
    talk = 'for number in range(20_000): print("a" * 80)'
    with Processes(full) as processes:
        processes.start('a', [sys.executable, '-c', talk], os.environ)
        wait_until(lambda: processes.ended() is not None)
        assert processes.ended().code == 0


def test_program_that_ended_by_itself_is_named():
    with Processes(Said()) as processes:
        processes.start('a', SLEEP, os.environ, ready='up')
        processes.start('b', [sys.executable, '-c', 'raise SystemExit(3)'], os.environ)
        wait_until(lambda: processes.ended() is not None)
        assert str(processes.ended()) == 'b ended with exit code 3'


def test_program_that_was_killed_is_named():
    with Processes(Said()) as processes:
        processes.start('a', SLEEP, os.environ, ready='up')
        os.kill(processes.ids['a'], signal.SIGKILL)
        wait_until(lambda: processes.ended() is not None)
        assert str(processes.ended()) == 'a was killed by signal 9'


def test_program_that_ignores_the_signal_is_killed(monkeypatch):
    patience = ((signal.SIGTERM, 0.2), (signal.SIGKILL, 2.0))
    monkeypatch.setattr('ivfmc_ros.cli.support.processes._PATIENCE', patience)
    with Processes(Said()) as processes:
        processes.start('a', STUBBORN, os.environ, ready='up')
        pid = processes.ids['a']
    assert not is_alive(pid)


def test_program_on_which_others_depend_is_ended_last():
    said = Said()
    # looks at the other one half a second after the signal
    program = (
        'import os, signal, sys, time\n'
        'def end(*_):\n'
        '    time.sleep(0.5)\n'
        '    print(os.path.exists("/proc/" + sys.argv[1] + "/exe"), flush=True)\n'
        '    sys.exit()\n'
        'signal.signal(signal.SIGTERM, end)\n'
        'print("up", flush=True)\n'
        'time.sleep(60)\n'
    )
    with Processes(said) as processes:
        processes.start('base', SLEEP, os.environ, ready='up')
        pid = str(processes.ids['base'])
        processes.start('user', [sys.executable, '-c', program, pid], os.environ)
        wait_until(lambda: ('user', 'up') in said)
    assert said[-1] == ('user', 'True')


def test_children_of_children_go_too():
    said = Said()
    with Processes(said) as processes:
        processes.start('a', PARENT, os.environ, ready='up')
        grandchild = int(said[0][1])
        assert is_alive(grandchild)
    wait_until(lambda: not is_alive(grandchild))


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGTERM])
def test_no_orphan_when_the_parent_is_killed(number, tmp_path):
    program = (
        'import os, sys, time\n'
        'from ivfmc_ros.cli.support.processes import Processes\n'
        f'p = Processes(lambda name, line: None)\n'
        f'p.start("a", {SLEEP!r}, os.environ, ready="up")\n'
        'print(p.ids["a"], flush=True)\n'
        'time.sleep(60)\n'
    )
    parent = subprocess.Popen(
        [sys.executable, '-c', program],
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).resolve().parents[3],
    )
    child = int(parent.stdout.readline())
    assert is_alive(child)
    parent.send_signal(number)
    parent.wait()
    wait_until(lambda: not is_alive(child))


def test_program_that_does_not_become_ready_is_named():
    with Processes(Said()) as processes, pytest.raises(HelperError, match='a ended with exit'):
        processes.start('a', [sys.executable, '-c', 'print("no")'], os.environ, ready='up')


def test_program_that_takes_too_long_is_named():
    with Processes(Said()) as processes, pytest.raises(HelperError, match='was not ready after'):
        processes.start('a', SLEEP, os.environ, ready='never', seconds=0.3)


def test_program_that_ended_is_started_again_in_its_place():
    said = []
    with Processes(lambda name, line: said.append((name, line))) as processes:
        processes.start('first', SLEEP, os.environ, ready='up')
        processes.start('second', SLEEP, os.environ, ready='up')
        before = processes.ids['first']
        os.kill(before, signal.SIGKILL)
        wait_until(lambda: processes.ended() is not None)
        assert processes.ended(known={'first'}) is None
        processes.restart('first')
        wait_until(lambda: said.count(('first', 'up')) == 2)
        assert processes.ended() is None
        assert list(processes.ids) == ['first', 'second']
        assert processes.ids['first'] != before
    assert not is_alive(before)


def test_children_of_a_program_that_ended_do_not_survive_its_restart():
    said = []
    with Processes(lambda name, line: said.append(line)) as processes:
        processes.start('parent', PARENT, os.environ, ready='up')
        child = int(said[0])
        os.kill(processes.ids['parent'], signal.SIGKILL)
        wait_until(lambda: processes.ended() is not None)
        processes.restart('parent')
        wait_until(lambda: not is_alive(child))
