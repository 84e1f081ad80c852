# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Process that sends the off bytes of a motion controller when the beats of its driver end.

``python -I -S process.py PORT BEATS TIMEOUT HEX:SECONDS...``: PORT and BEATS are file descriptors
that the process inherits, of the open port and of the pipe that the beats come through. It runs
without the package, so that it starts in some 20 ms.

A beat is one byte: ``1`` while a laser may be on or the table moves, ``0`` otherwise, ``q`` to
end. Where no beat comes for TIMEOUT seconds after a ``1``, or the pipe is closed without ``q``,
the bytes HEX are sent, each with a pause of SECONDS after it. Before the first of them to a driver
that hangs, ``!`` is written to the standard output: a driver that goes on reads there what stopped
its table. The process ends with its driver, and when the port is unplugged.
"""

from collections.abc import Sequence
import contextlib
import os
import select
import sys
import time

# Seconds in which bytes are tried to be written: the buffer of the port may be full.
_WRITE_S = 0.3
_RETRY_S = 0.01
# Times that the bytes are sent to a driver that hangs: it may send something in between.
_REPEATS = 3
LIT, DARK, END, ACTED = b'1', b'0', b'q', b'!'
_STANDARD_OUTPUT = 1


def main(arguments: Sequence[str]) -> int:
    """Watch until the driver ends."""
    port, beats, timeout = int(arguments[0]), int(arguments[1]), float(arguments[2])
    steps = []
    for text in arguments[3:]:
        data, _, seconds = text.partition(':')
        steps.append((bytes.fromhex(data), float(seconds)))
    watch(port, beats, timeout, steps)
    return 0


def watch(port: int, beats: int, timeout: float, steps: Sequence[tuple[bytes, float]]) -> None:
    """Watch until the driver ends; see the module."""
    poller = select.poll()
    poller.register(beats, select.POLLIN)
    # hang-ups and errors are reported without being asked for
    poller.register(port, 0)
    lit, fired = False, 0
    while True:
        events = dict(poller.poll(timeout * 1000))
        if port in events:
            return
        if not events:
            # no beat: the driver hangs, or was stopped
            if lit and fired < _REPEATS:
                if not fired:
                    report()
                send(port, steps)
                fired += 1
            continue
        received = os.read(beats, 4096)
        if END in received:
            return
        if not received:
            # the driver died
            send(port, steps)
            return
        lit, fired = received[-1:] == LIT, 0


def report() -> None:
    """Tell the driver that the bytes are about to be sent."""
    # the beam comes first
    with contextlib.suppress(OSError):
        os.write(_STANDARD_OUTPUT, ACTED)


def send(port: int, steps: Sequence[tuple[bytes, float]]) -> None:
    """Send the bytes."""
    for data, seconds in steps:
        deadline, written = time.monotonic() + _WRITE_S, 0
        while written < len(data) and time.monotonic() < deadline:
            try:
                written += os.write(port, data[written:])
            except BlockingIOError:
                time.sleep(_RETRY_S)
            except OSError:
                return
        time.sleep(seconds)


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
