# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Becomes another program that ends when its parent does, however that ends.

``python -m ivfmc_ros.cli.support.child PARENT_PID PROGRAM ARGUMENTS``. The kernel sends
the signal, so that it comes after SIGKILL of the parent as well. Doing this between fork and exec
instead would run Python in a forked process with threads, where it may hang.
"""

from collections.abc import Sequence
import ctypes
import os
import signal
import sys

_PR_SET_PDEATHSIG = 1


def become(parent: int, program: Sequence[str]) -> None:
    """Replace this process; SIGTERM comes when ``parent`` ends."""
    libc = ctypes.CDLL(None, use_errno=True)
    libc.prctl(_PR_SET_PDEATHSIG, int(signal.SIGTERM), 0, 0, 0)
    if os.getppid() != parent:
        sys.exit('its parent has ended already')
    os.execvp(program[0], list(program))


if __name__ == '__main__':
    become(int(sys.argv[1]), sys.argv[2:])
