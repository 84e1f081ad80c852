# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import os
import runpy
import signal
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
