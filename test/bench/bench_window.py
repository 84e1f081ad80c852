# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Work window: what browsers cost a scan, and how late a profile is on the screen.

The cell is simulated, and the browsers run on the same two cores and draw by the processor. They
stand for other computers, so that they run at idle priority: the kernel gives them what the cell
leaves.
"""

from collections.abc import Iterator
import contextlib
from contextlib import contextmanager
import json
import math
import os
from pathlib import Path
import statistics
import tempfile
from typing import Any

import numpy as np
import psutil
from sensor_msgs.msg import PointCloud2
from support.browser import browser
from support.browser import open_page
from support.cell_rig import Cell
from support.graph_rig import following_client
from support.small_cell import small_cell_options

from bench import at_most
from bench import Number
from ivfmc_ros.nodes.convert.stamps import nanoseconds

PORT = 8189
COUNTS = (0, 1, 5)
SCAN = {'motion': 'continuous', 'profiles': 120, 'profile_rate': 10.0, 'lasers': ['left', 'right']}
# The page of viser receives in a worker. Notes how many points of profiles have come, and when the
# picture with them is on the screen: the second animation frame after they came.
HOOK = """
window.drawn = [];
const Original = window.Worker;
window.Worker = class extends Original {
  constructor(...given) {
    super(...given);
    this.addEventListener('message', (event) => {
      const batch = event.data.type === 'message_batch' ? event.data.messages : [];
      const clouds = batch.filter((one) =>
        one.type === 'PointCloudMessage' && one.name.startsWith('/profiles/'));
      const points = clouds.reduce((sum, one) => sum + one.props.colors.byteLength / 3, 0);
      if (points) requestAnimationFrame(() => requestAnimationFrame(() => {
        window.drawn.push([points, performance.timeOrigin + performance.now()]);
      }));
    });
  }
};
"""


def run() -> Iterator[Number]:
    with tempfile.TemporaryDirectory() as folder, following_client() as client:
        options = small_cell_options(Path(folder))
        cell = Cell(Path(folder) / 'run', *options, '--window', '--set', f'window.port={PORT}')
        try:
            client.until(lambda: client.status, 90.0, 'no cell')
            client.until(lambda: 'serving' in client.diagnostic('window'), 60.0, 'no window')
            seconds: dict[int, float] = {}
            for count in COUNTS:
                name = f'{count} browser{"" if count == 1 else "s"}'
                try:
                    with _browsers(count) as pages:
                        lost, seconds[count] = _scan(client)
                        latency = _latency(client, pages[0]) if count == 1 else []
                except TimeoutError as error:
                    # of so many browsers that draw by the processor
                    yield Number(f'{name}: profiles lost', math.nan, '', at_most(0), str(error))
                    continue
                yield Number(f'{name}: profiles lost', lost, '', at_most(0))
                if count:
                    ratio = seconds[count] / seconds[0]
                    note = f'{seconds[count]:.1f} s of scanning, {seconds[0]:.1f} s without'
                    yield Number(f'{name}: time / without', ratio, '', at_most(1.05), note)
                if count == 1:
                    note = f'of {len(latency)} profiles, from the start of their exposure'
                    value = statistics.median(latency) if latency else math.nan
                    yield Number('profile to pixel, median', value, 's', at_most(0.3), note)
        finally:
            cell.kill()


@contextmanager
def _browsers(count: int) -> Iterator[list[Any]]:
    if not count:
        yield []
        return
    with browser(count) as pages:
        for page in pages:
            page.add_init_script(HOOK)
            open_page(page, f'http://127.0.0.1:{PORT}')
            _await_page(page, count)
        _make_idle()
        yield pages


def _await_page(page: Any, count: int) -> None:
    from playwright.sync_api import TimeoutError as Late

    try:
        page.get_by_role('button', name='Start scan').wait_for(timeout=120_000)
    except Late:
        raise TimeoutError(f'{count} browsers do not open on this computer') from None


def _make_idle() -> None:
    """Give the browsers what the cell leaves: every thread, of which some have a high priority."""
    for process in psutil.process_iter(['name']):
        if process.info['name'] in ('chromium', 'chrome'):
            for thread in process.threads():
                with contextlib.suppress(ProcessLookupError):
                    os.sched_setscheduler(thread.id, os.SCHED_IDLE, os.sched_param(0))


def _scan(client: Any) -> tuple[int, float]:
    """Return how many profiles were not recorded, and the seconds of scanning."""
    client.profiles = []

    def note(message: PointCloud2) -> None:
        points = message.width * message.height
        client.profiles.append((1e-9 * nanoseconds(message.header.stamp), points))

    subscription = client.node.create_subscription(PointCloud2, 'profile', note, 100)
    assert client.set('orchestrator', **SCAN).successful
    success, answer = client.trigger('start_scan')
    assert success, answer

    def ended() -> bool:
        values = {item.key: item.value for item in client.status[-1].values}
        return values['scan_id'] == answer['scan_id'] and bool(values['result'])

    client.until(ended, 300.0, 'the scan has not ended')
    client.node.destroy_subscription(subscription)
    values = {item.key: item.value for item in client.status[-1].values}
    result = json.loads(values['result'])
    assert result['code'] == 'OK', result
    lost = len(client.profiles) - result['counts']['profiles'] + result['counts']['dropped']
    return abs(lost), float(result['seconds']['scanning'])


def _latency(client: Any, page: Any) -> list[float]:
    """
    Return seconds from the exposure of each profile to the first picture with all of its points.

    The page receives the points in the order of the profiles, and none is left out.
    """
    drawn = [(points, 1e-3 * shown) for points, shown in page.evaluate('window.drawn')]
    on_screen = np.cumsum([points for points, _ in drawn])
    published = np.cumsum([points for _, points in client.profiles])
    first = np.searchsorted(on_screen, published)
    return [
        drawn[index][1] - stamp
        for index, (stamp, points) in zip(first, client.profiles, strict=True)
        if points and index < len(drawn)
    ]
