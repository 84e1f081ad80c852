# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import os
from pathlib import Path
import runpy
import signal
import subprocess
import sys
import threading
import time

import pytest

from ivfmc_ros.errors import CancelledError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.stripe.channel import channel_weights
from ivfmc_ros.worker import Worker


@pytest.fixture
def worker():
    worker = Worker()
    yield worker
    worker.close()


def test_job_runs_in_another_process(worker):
    assert worker.run(os.getpid) != os.getpid()


def test_modules_are_imported_before_the_first_job(tmp_path, monkeypatch):
    (tmp_path / 'slow_to_import.py').write_text('')
    monkeypatch.setenv('PYTHONPATH', str(tmp_path))
    worker = Worker(['slow_to_import'])
    try:
        known = worker.run(eval, '"slow_to_import" in __import__("sys").modules')
    finally:
        worker.close()
    assert known


def test_exception_of_a_job_is_raised_in_the_parent(worker):
    with pytest.raises(ScanError, match='ZeroDivisionError'):
        worker.run(divmod, 1, 0)
    with pytest.raises(ParameterError, match='pink'):
        worker.run(channel_weights, 'pink')


def test_killed_job_is_cancelled_and_the_next_one_runs(worker, tmp_path):
    caught = []
    script = tmp_path / 'long.py'
    script.write_text(f'open({str(tmp_path / "started")!r}, "w"); import time; time.sleep(60)')

    def wait():
        try:
            worker.run(runpy.run_path, str(script))
        except CancelledError as error:
            caught.append(error)

    thread = threading.Thread(target=wait)
    thread.start()
    started = tmp_path / 'started'
    while not started.exists():
        time.sleep(0.01)
    worker.kill()
    thread.join(10)
    assert caught
    assert worker.run(abs, -3) == 3


def test_dead_worker_is_reported_and_replaced(worker):
    with pytest.raises(ScanError, match='died'):
        worker.run(os.kill, worker.run(os.getpid), signal.SIGKILL)
    assert worker.run(abs, -3) == 3


def in_thread(function, *arguments):
    """Run a call in a thread that ends with it, as the nodes do."""
    found = []

    def work():
        try:
            found.append(function(*arguments))
        except ScanError as error:
            found.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join(30)
    return found[0]


def test_process_started_by_a_thread_outlives_it(worker):
    # the kernel's PR_SET_PDEATHSIG counts the thread that forked as the parent
    worker.kill()
    first = in_thread(worker.run, os.getpid)
    assert isinstance(first, int), first
    for _ in range(10):
        assert in_thread(worker.run, os.getpid) == first


def test_job_cancelled_before_it_began_does_not_run(worker, tmp_path):
    place = tmp_path / 'made'
    with pytest.raises(CancelledError):
        worker.run(os.mkdir, str(place), cancelled=lambda: True)
    assert not place.exists()
    assert worker.run(abs, -3) == 3


def test_worker_ends_with_its_node(tmp_path):
    """Also by SIGKILL, while a job holds the interpreter."""
    program = (
        'import os, threading, time\n'
        'from ivfmc_ros.worker import Worker\n'
        'worker = Worker()\n'
        'print(worker.run(os.getpid), flush=True)\n'
        'worker.run(time.sleep, 60)\n'
    )
    with subprocess.Popen(
        [sys.executable, '-c', program], stdout=subprocess.PIPE, text=True
    ) as node:
        child = int(node.stdout.readline())
        node.kill()
    deadline = time.monotonic() + 10
    while Path(f'/proc/{child}/cmdline').exists() and Path(f'/proc/{child}/cmdline').read_bytes():
        assert time.monotonic() < deadline
        time.sleep(0.02)
