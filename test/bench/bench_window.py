# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Work window: what browsers cost a scan, and how late a profile is on the screen.

The cell is simulated; its camera has its pictures before the scan. The browsers run on the same
two cores and draw by the processor. They stand for other computers, so that they run at idle
priority: the kernel gives them what the cell leaves, and what they wait for it is in the time to
the screen. Two cores do not draw five 3-D views: four of five browsers receive all, and draw
nothing.
"""

from collections.abc import Iterator
import contextlib
from contextlib import contextmanager
from functools import partial
import math
import os
from pathlib import Path
import signal
import statistics
import tempfile
from typing import Any

import numpy as np
import psutil
from sensor_msgs.msg import PointCloud2
from support.browser import browser
from support.browser import open_page
from support.graph_rig import following_client
from support.page_clients import page_clients
from support.prerendered_camera import PICTURES
from support.prerendered_camera import PrerenderedCell
from support.prerendered_camera import write_pictures
from support.scan_result import await_result
from support.small_cell import small_cell
from support.small_cell import small_cell_options

from bench import at_most
from bench import Number
from bench.pool import mapped
from ivfmc_ros.storage.bag.reader import open_bag
from ivfmc_ros.storage.messages.point_clouds import to_profile

PORT = 8189
COUNTS = (1, 5)
NOTES = {1: '', 5: '; one Chromium, and four that receive the same and draw nothing'}
# Seconds until the workers of the cell have imported their libraries.
SETTLE_S = 45.0
SCAN: dict[str, Any] = {
    'motion': 'continuous',
    'profiles': 120,
    'profile_rate': 10.0,
    'lasers': ['left', 'right'],
}
# The page of viser receives in a worker. Notes how many points of profiles have come, when, and
# when the picture with them is on the screen: the second animation frame after they came.
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
      const now = () => performance.timeOrigin + performance.now();
      const arrived = now();
      if (points) requestAnimationFrame(() => requestAnimationFrame(() => {
        window.drawn.push([points, arrived, now()]);
      }));
    });
  }
};
"""


def run() -> Iterator[Number]:
    with tempfile.TemporaryDirectory() as folder, following_client() as client:
        options = small_cell_options(Path(folder))
        pictures = Path(folder) / 'pictures'
        pictures.mkdir()
        model = small_cell()
        render = partial(write_pictures, pictures, model, SCAN['profiles'])
        mapped(render, range(len(model.lasers)))
        cell = PrerenderedCell(
            Path(folder) / 'run',
            *options,
            *('--window', '--set', f'window.port={PORT}'),
            **{PICTURES: str(pictures)},
        )
        try:
            client.until(lambda: client.status, 90.0, 'no cell')
            client.until(lambda: 'serving' in client.diagnostic('window'), 60.0, 'no window')
            client.spin(SETTLE_S)
            lost, without = _scan(client)
            yield Number('0 browsers: profiles lost', lost, '', at_most(0))
            for count in COUNTS:
                yield from _with_browsers(client, count, without)
            yield from _with_stuck_browser(client, without)
        finally:
            cell.kill()


def _with_browsers(client: Any, count: int, without: float) -> Iterator[Number]:
    name = f'{count} browser{"" if count == 1 else "s"}'
    try:
        with _browser() as page, page_clients(PORT, count - 1) as others:
            before = [other.received for other in others]
            lost, seconds = _scan(client)
            arrived, shown = _latency(client, page)
            received = [other.received - past for other, past in zip(others, before, strict=True)]
    except TimeoutError as error:
        # a browser that draws by the processor
        yield Number(f'{name}: profiles lost', math.nan, '', at_most(0), str(error))
        return
    yield from _cost(name, lost, seconds, without, NOTES[count])
    note = f'of {len(shown)} profiles, from their message'
    yield Number(f'{name}: profile to page, median', _median(arrived), 's', None, note)
    bar = at_most(0.3) if count == 1 else None
    yield Number(f'{name}: profile to pixel, median', _median(shown), 's', bar, note)
    if received:
        yield Number(f'{name}: sent to each', min(received) / 1e6, 'MB')


def _with_stuck_browser(client: Any, without: float) -> Iterator[Number]:
    """Measure a scan whose page does not read what it is sent."""
    with _browser():
        _signal_browsers(signal.SIGSTOP)
        try:
            found = _scan(client)
        finally:
            _signal_browsers(signal.SIGCONT)
    yield from _cost('1 stuck browser', *found, without)


def _cost(
    name: str, lost: int, seconds: float, without: float, what: str = ''
) -> Iterator[Number]:
    yield Number(f'{name}: profiles lost', lost, '', at_most(0))
    note = f'{seconds:.1f} s of scanning, {without:.1f} s without{what}'
    yield Number(f'{name}: time / without', seconds / without, '', at_most(1.05), note)


def _median(seconds: list[float]) -> float:
    return statistics.median(seconds) if seconds else math.nan


@contextmanager
def _browser() -> Iterator[Any]:
    from playwright.sync_api import TimeoutError as Late

    with browser() as [page]:
        page.add_init_script(HOOK)
        open_page(page, f'http://127.0.0.1:{PORT}')
        try:
            page.get_by_role('button', name='Start scan').wait_for(timeout=120_000)
        except Late:
            raise TimeoutError('the browser does not open the page on this computer') from None
        _make_idle()
        yield page


def _make_idle() -> None:
    """Give the browsers what the cell leaves: all threads, of which some have a high priority."""
    # the kernel shares the processor among sessions first; each node has a session of its own
    group = Path('/proc/self/autogroup')
    if group.exists():
        group.write_text('19')
    for process in _browser_processes():
        for thread in process.threads():
            with contextlib.suppress(ProcessLookupError):
                os.sched_setscheduler(thread.id, os.SCHED_IDLE, os.sched_param(0))


def _signal_browsers(number: int) -> None:
    for process in _browser_processes():
        with contextlib.suppress(psutil.NoSuchProcess):
            process.send_signal(number)


def _browser_processes() -> list[psutil.Process]:
    """Return the processes of the browsers that this process has started."""
    started = psutil.Process().children(recursive=True)
    return [process for process in started if process.name() in ('chromium', 'chrome')]


def _scan(client: Any) -> tuple[int, float]:
    """Return how many profiles were not recorded, and the seconds of scanning."""
    received: list[PointCloud2] = []
    subscription = client.node.create_subscription(PointCloud2, 'profile', received.append, 100)
    assert client.set('orchestrator', **SCAN).successful
    success, answer = client.trigger('start_scan')
    assert success, answer

    result = await_result(client, answer['scan_id'], 300.0)
    client.node.destroy_subscription(subscription)
    assert result['code'] == 'OK', result
    lost = len(received) - result['counts']['profiles'] + result['counts']['dropped']
    client.folder = Path(result['folder'])
    return abs(lost), float(result['seconds']['scanning'])


def _latency(client: Any, page: Any) -> tuple[list[float], list[float]]:
    """
    Return seconds from the message of each profile until all of its points are in the page, and
    until the first picture with them.

    The page receives the points in the order of the profiles, and none is left out.
    """
    batches = np.array(page.evaluate('window.drawn')).reshape(-1, 3)
    profiles = _recorded(client.folder)
    # a profile may come in several batches
    batch = np.searchsorted(np.cumsum(batches[:, 0]), np.cumsum(profiles[:, 1]))
    came = batch < len(batches)
    times = 1e-3 * batches[batch[came], 1:] - profiles[came, :1]
    return times[:, 0].tolist(), times[:, 1].tolist()


def _recorded(folder: Path) -> Any:
    """Return when the recorder received each profile with points, seconds, and their number."""
    bag = open_bag(folder)
    [name] = [name for name in bag.topics if name.endswith('/profile')]
    decode = bag.decoder(name)
    profiles = [
        (1e-9 * raw.log_time_ns, len(to_profile(decode(raw), name)))
        for raw in bag.messages([name])
    ]
    return np.array([one for one in profiles if one[1]]).reshape(-1, 2)
