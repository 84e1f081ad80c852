# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A driver in a process of its own, with a laser on or a table that moves, to be killed or stopped.

``python -m support.driver_process PORT FIRMWARE lit|moving`` writes ``ready`` when it is so.
"""

from collections.abc import Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import subprocess
import sys
import time

from ivfmc_ros.devices.any_controller import AnyController
from ivfmc_ros.devices.beam import BeamInterlock
from ivfmc_ros.devices.beam import BeamSettings
from ivfmc_ros.devices.guard.beam_guard import BeamGuard
from ivfmc_ros.devices.turntable import TurntableDriver
from support.controllers import settings_for

ROOT = Path(__file__).resolve().parents[2]
HOLD_S = 0.05


def main() -> None:
    port, firmware, state = sys.argv[1:]
    guard = BeamGuard()
    driver = TurntableDriver(
        AnyController(settings_for(firmware, Path(port))),
        BeamInterlock(('left', 'right'), BeamSettings()),
        velocity=0.5,
        reconnect=True,
        guard=guard,
    )
    driver.start()
    moving = False
    while True:
        driver.hold('left')
        now = driver.state()
        if now.lasers['left'] and state == 'moving' and not moving:
            driver.command(now.position + 20.0, 0.0)
            moving = True
        if now.lasers['left'] and (state == 'lit' or now.moving):
            sys.stdout.write(f'ready {guard.pid}\n')
            sys.stdout.flush()
            state = 'said'
        time.sleep(HOLD_S)


@contextmanager
def driving(port: Path, firmware: str, state: str) -> Iterator[tuple[subprocess.Popen[str], int]]:
    """Run a driver until its laser is on; the result is its process and the id of its guard."""
    process = subprocess.Popen(
        [sys.executable, '-m', 'support.driver_process', str(port), firmware, state],
        env={**os.environ, 'PYTHONPATH': f'{ROOT}/test'},
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        word, guard = process.stdout.readline().split()
        assert word == 'ready'
        yield process, int(guard)
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


if __name__ == '__main__':
    main()
