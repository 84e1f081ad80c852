# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scans while other work keeps all cores busy: no living node is declared dead."""

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time
from typing import Any

from support.cell_rig import Cell
from support.graph_rig import Client
from support.graph_rig import following_client
from support.scan_result import await_result
from support.small_cell import small_cell_options

from bench import at_most
from bench import Number

# Processes that compute all the time, each in a session of its own as the nodes are: the kernel
# shares the processor among sessions.
LOAD = 10
# Seconds after which the average of a minute shows the load.
RISE_S = 60.0
SCAN_S = 600.0
STEP = {'motion': 'step', 'profiles': 12}
CONTINUOUS = {'motion': 'continuous', 'profiles': 60, 'profile_rate': 5.0}
SCANS = (STEP, CONTINUOUS, STEP, CONTINUOUS, STEP, CONTINUOUS)


def loaded_scans() -> Iterator[Number]:
    """Count the scans that do not end as OK."""
    with tempfile.TemporaryDirectory() as name, following_client() as client:
        cell = Cell(Path(name) / 'run', *small_cell_options(Path(name)))
        try:
            client.until(lambda: client.status, 120.0, 'no scan_status')
            with _load():
                client.spin(RISE_S)
                begin = time.monotonic()
                results = [_scanned(client, scan) for scan in SCANS]
                seconds = (time.monotonic() - begin) / len(results)
                load = os.getloadavg()[0]
        finally:
            cell.kill()
    codes = Counter(result['code'] for result in results)
    details = '; '.join(result['detail'] for result in results if result['code'] != 'OK')
    note = ', '.join(f'{count} {code}' for code, count in codes.items()) + f' {details}'.rstrip()
    failed = len(results) - codes['OK']
    row = f'{LOAD} busy processes'
    yield Number(f'{row}: scans that failed', failed, f'of {len(results)}', at_most(0), note)
    yield Number(f'{row}: seconds of a scan', seconds, 's', None, f'load {load:.1f}')


@contextmanager
def _load() -> Iterator[None]:
    # they end with the bench, also where it is killed
    work = f'import os\nwhile os.getppid() == {os.getpid()}: pass'
    busy = [
        subprocess.Popen([sys.executable, '-c', work], start_new_session=True) for _ in range(LOAD)
    ]
    try:
        yield
    finally:
        for process in busy:
            process.kill()
            process.wait()


def _scanned(client: Client, scan: dict[str, Any]) -> dict[str, Any]:
    set_ = client.set('orchestrator', lasers=['left', 'right'], **scan)
    assert set_.successful, set_.reason
    success, answer = client.trigger('start_scan', SCAN_S)
    assert success, answer

    return await_result(client, answer['scan_id'], SCAN_S)
