# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import signal
import subprocess
import sys

import pytest

from ivfmc_ros.cli.support.shared_memory import remove_dead_segments

OWNER = (
    'import fcntl, sys, time\n'
    'handle = open(sys.argv[1] + "_el", "w")\n'
    'open(sys.argv[1], "wb").write(bytes(8192))\n'
    'fcntl.flock(handle, fcntl.LOCK_EX)\n'
    'print("up", flush=True)\n'
    'time.sleep(60)\n'
)


@pytest.fixture
def segment(tmp_path):
    """A segment and the process that owns it, as Fast DDS makes them."""
    path = tmp_path / 'fastrtps_0123456789abcdef'
    owner = subprocess.Popen(
        [sys.executable, '-c', OWNER, str(path)], stdout=subprocess.PIPE, text=True
    )
    assert owner.stdout.readline() == 'up\n'
    yield path, owner
    owner.kill()
    owner.communicate()


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_segment_of_a_living_process_stays(segment, tmp_path):
    path, owner = segment
    owner.send_signal(signal.SIGSTOP)
    assert remove_dead_segments(tmp_path, 0.0) == 0
    assert names(tmp_path) == [path.name, f'{path.name}_el']


def test_segment_of_a_killed_process_is_removed(segment, tmp_path):
    _path, owner = segment
    owner.kill()
    owner.wait()
    for name in ('fastrtps_port7412', 'other', 'fastrtps_fedcba9876543210'):
        (tmp_path / name).write_bytes(b'stays')
    assert remove_dead_segments(tmp_path) == 0
    assert remove_dead_segments(tmp_path, 0.0) == 8192
    assert names(tmp_path) == ['fastrtps_fedcba9876543210', 'fastrtps_port7412', 'other']
