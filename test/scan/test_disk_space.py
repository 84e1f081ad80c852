# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import pytest

from ivfmc_ros.errors import DiskFullError
from ivfmc_ros.errors import FileError
from ivfmc_ros.scan.disk_space import DiskWatch
from ivfmc_ros.scan.disk_space import SpaceEstimate


class Disk:
    """A disk with ``free`` bytes, and a clock."""

    def __init__(self, free):
        self.free, self.now, self.looks = free, 0.0, 0

    def watch(self, folder, reserve):
        def look(_):
            self.looks += 1
            return self.free

        return DiskWatch(folder, reserve, free=look, clock=lambda: self.now)


def test_scan_that_does_not_fit_is_refused_with_the_numbers(tmp_path):
    watch = Disk(500e6).watch(tmp_path, 200e6)
    watch.require_room(300e6)
    with pytest.raises(DiskFullError, match=r'500 MB are free; the scan takes about 301 MB') as e:
        watch.require_room(301e6)
    assert e.value.code == 'DISK_FULL'


def test_disk_that_fills_up_is_noticed_within_a_second(tmp_path):
    disk = Disk(500e6)
    watch = disk.watch(tmp_path, 200e6)
    for step in range(100):
        disk.now = 0.02 * step
        watch.require_reserve()
    # two seconds: a look a second is enough, and cheap
    assert disk.looks == 2
    disk.free, disk.now = 199e6, 3.5
    with pytest.raises(DiskFullError, match='only 199 MB are free'):
        watch.require_reserve()


def test_real_disk_is_looked_up_and_a_missing_one_is_named(tmp_path):
    DiskWatch(tmp_path, 1.0).require_reserve()
    with pytest.raises(FileError, match='none: cannot be looked up: No such file'):
        DiskWatch(tmp_path / 'none', 1.0).require_reserve()


def test_space_of_a_scan_is_that_of_the_last_one_by_profile(tmp_path):
    estimate = SpaceEstimate()
    assert estimate.of(400) == 0.0
    (tmp_path / 'scan.mcap').write_bytes(b'x' * 3000)
    (tmp_path / 'mesh.stl').write_bytes(b'x' * 1000)
    estimate.learn(tmp_path, 100)
    assert estimate.of(400) == 16_000.0
    estimate.learn(tmp_path / 'deleted', 100)
    estimate.learn(tmp_path, 0)
    assert estimate.of(400) == 16_000.0
