# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Emulates a clock that is set: shifts the wall clock of every Python process that finds this module.

A test may not set the clock of its computer. Python imports this module at the start of a process
whose path has this folder. ``time.time``, ``time.time_ns`` and the system clocks of rclpy, which
stamp all messages of the nodes, are shifted by the seconds in two files of the folder
IVFMC_CLOCK_STEP: ``all``, and the name of the node. Steady clocks are not shifted.
"""

from importlib.abc import MetaPathFinder
import importlib.machinery
import mmap
import os
from pathlib import Path
import re
import struct
import sys
import time

_FOLDER = os.environ.get('IVFMC_CLOCK_STEP', '')
_SHIFTED = 'rclpy.clock'


def _node() -> str:
    """Return the name of the node that this process runs, '' for another program."""
    words = Path('/proc/self/cmdline').read_bytes().decode(errors='replace').split('\0')
    names = [re.fullmatch(r'ivfmc_ros\.nodes\.([a-z]+)', word) for word in words]
    return next((name[1] for name in names if name), '')


def _opened(name: str) -> mmap.mmap:
    with (Path(_FOLDER) / name).open('rb') as stream:
        return mmap.mmap(stream.fileno(), 8, access=mmap.ACCESS_READ)


class _Finder(MetaPathFinder):
    """Shifts the clocks of rclpy when it is imported."""

    def find_spec(self, name, path, target=None):
        if name != _SHIFTED:
            return None
        sys.meta_path.remove(self)
        spec = importlib.machinery.PathFinder.find_spec(name, path)
        load = spec.loader.exec_module

        def exec_module(module):
            load(module)
            _shift_rclpy(module)

        spec.loader.exec_module = exec_module
        return spec


def _shift_rclpy(module) -> None:
    now = module.Clock.now

    def shifted(self):
        found = now(self)
        if self.clock_type is module.ClockType.STEADY_TIME:
            return found
        return module.Time(nanoseconds=found.nanoseconds + _shift_ns(), clock_type=self.clock_type)

    module.Clock.now = shifted


def _shift_ns() -> int:
    return sum(round(struct.unpack('d', file[:8])[0] * 1e9) for file in _FILES)


if _FOLDER and Path(_FOLDER).is_dir():
    _FILES = [_opened(name) for name in filter(None, ('all', _node()))]
    _time_ns = time.time_ns
    time.time_ns = lambda: _time_ns() + _shift_ns()
    time.time = lambda: (_time_ns() + _shift_ns()) * 1e-9
    sys.meta_path.insert(0, _Finder())
