# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Jobs without pictures for the tests of many jobs at once; they run in processes of their own."""

from dataclasses import dataclass
import os
from pathlib import Path
import signal
import time


@dataclass(frozen=True)
class Task:
    """Write a line to a file; with ``dies`` the process kills itself afterwards."""

    name: str
    log: Path
    dies: bool = False


def work(task):
    with task.log.open('a') as stream:
        stream.write(f'{task.name}\n')
    if task.dies:
        os.kill(os.getpid(), signal.SIGKILL)
    return task.name


def slow_work(task):
    time.sleep(0.4)
    return work(task)
