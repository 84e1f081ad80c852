# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A simulated cell of real processes: its faults on request, and what is measured of them."""

from collections.abc import Callable
import json
import math
import os
from pathlib import Path
import signal
import struct
import subprocess
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
from std_msgs.msg import UInt64
from std_srvs.srv import Trigger

from ivfmc_ros.cli.support.cell_run import NODES
from ivfmc_ros.errors import BagError
from ivfmc_ros.errors import FileError
from ivfmc_ros.files import write_text
from ivfmc_ros.meshing.io.export import write_solid
from ivfmc_ros.nodes.framework import qos
from ivfmc_ros.simulation.live.folder import LiveFolder
from ivfmc_ros.simulation.live.truth import TruthReader
from ivfmc_ros.storage.bag.reader import open_bag
from ivfmc_ros.storage.messages.point_clouds import to_structured_array
from ivfmc_ros.storage.scans.scan_messages import recorded_profile_headers
from support.cell_rig import Cell
from support.cell_rig import gone
from support.graph_rig import Client
from support.rendered_faults import part_called
from support.shape_error import likely_turns
from support.shape_error import share_off
from support.small_cell import small_cell_options

CLOCK_STEP = Path(__file__).with_name('clock_step')
# Seconds until a cell is up, or a scan has ended: only a failure takes so long, on a busy machine.
START_S, SCAN_S = 240.0, 120.0
# The beam may flicker at the end of a scan; resolution of the truth that is read, seconds.
_RESOLUTION_S = 0.005
_STRIDE = 9  # of the points that are compared
_CLOSING_S = 15.0  # seconds until a recording is closed whose orchestrator has to come back
# A part that shows a rotation on all sides; the demo part is mostly round.
_PART = 'bracket'
FINAL = ('DONE', 'FAILED', 'CANCELLED')


class FaultClient(Client):
    """
    A client that notes when it received what.

    states : (monotonic second, key-value pairs) of each scan_status
    counts : (monotonic second, number) of each message on ``recorded``
    """

    def __init__(self) -> None:
        super().__init__()
        self.states: list[tuple[float, dict[str, str]]] = []
        self.counts: list[tuple[float, int]] = []
        for kind, topic, function in (
            (DiagnosticStatus, 'scan_status', self._receive_status),
            (UInt64, 'recorded', self._receive_count),
        ):
            self.node.create_subscription(kind, topic, function, qos.of_topic(topic))

    def _receive_status(self, message: Any) -> None:
        values = {item.key: item.value for item in message.values}
        self.states.append((time.monotonic(), values))

    def _receive_count(self, message: Any) -> None:
        self.counts.append((time.monotonic(), int(message.data)))

    def forget(self) -> None:
        """Forget what was received of a former cell."""
        self.states.clear()
        self.counts.clear()
        self._diagnostics.clear()

    def forget_diagnostics(self) -> None:
        """Forget what nodes said that may have ended."""
        self._diagnostics.clear()

    def state(self, scan_id: str) -> dict[str, str]:
        """Return the last scan_status of a scan."""
        found = [values for _, values in self.states if values.get('scan_id') == scan_id]
        return found[-1] if found else {}

    def result(self, scan_id: str) -> tuple[float, dict[str, Any]] | None:
        """Return when the result of a scan was received, and the result."""
        for received_s, values in self.states:
            if values.get('scan_id') == scan_id and values.get('result'):
                return received_s, json.loads(values['result'])
        return None

    def ask(self, name: str, seconds: float = 10.0) -> tuple[bool, str, str]:
        """
        Call a Trigger whose node may have died.

        :returns: success, code and scan id; the code is 'no answer' where none came in time
        """
        client = self.node.create_client(Trigger, name)
        try:
            if not self.wait(client.service_is_ready, seconds):
                return False, 'no answer', ''
            future = client.call_async(Trigger.Request())
            if not self.wait(future.done, seconds):
                return False, 'no answer', ''
            answer = json.loads(future.result().message)
            return future.result().success, answer['code'], str(answer.get('scan_id', ''))
        finally:
            self.node.destroy_client(client)

    def send(self, name: str) -> None:
        """Call a Trigger and do not wait for its answer."""
        client = self.node.create_client(Trigger, name)
        assert self.wait(client.service_is_ready, 10.0), f'no service {name}'
        client.call_async(Trigger.Request())

    def wait(self, condition: Callable[[], object], seconds: float) -> bool:
        """Spin until ``condition()`` is true; return whether it became so in time."""
        deadline = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > deadline:
                return False
            self.executor.spin_once(timeout_sec=0.01)
        return True


class FaultCell:
    """
    A cell that ``ivfmc up --simulate`` started.

    home_switch : the table has one: its controller is locked until it is homed
    restarts : number of cells that were started
    orphans : processes that were left by cells that ended
    """

    def __init__(self, client: FaultClient, folder: Path, *, home_switch: bool = False) -> None:
        self.client, self._folder, self.home_switch = client, folder, home_switch
        self._cell: Cell | None = None
        self._truth: TruthReader | None = None
        self._pids: dict[str, int] = {}
        self.restarts = self.orphans = 0
        self._clocks = folder / 'clocks'

    # -- the processes

    @property
    def running(self) -> bool:
        """Whether ``ivfmc up`` runs."""
        return self._cell is not None and self._cell.up.poll() is None

    @property
    def log(self) -> str:
        """What the processes printed."""
        return self._cell.log() if self._cell else ''

    @property
    def scans(self) -> Path:
        """Folder of the scans."""
        return self._folder / f'cell_{self.restarts:03d}' / 'scans'

    def ensure(self) -> None:
        """Start the cell unless it is up; return when it can scan."""
        if self.running:
            # a node may just be started again
            self.client.forget_diagnostics()
            if self.client.wait(self._is_ready, START_S):
                return
        self.end()
        self.client.forget()
        self.restarts += 1
        folder = self._folder / f'cell_{self.restarts:03d}'
        self._clocks.mkdir(parents=True, exist_ok=True)
        for name in ('all', *NODES):
            (self._clocks / name).write_bytes(struct.pack('d', 0.0))
        self._cell = Cell(
            folder,
            *self.options(),
            PYTHONPATH=str(CLOCK_STEP),
            IVFMC_CLOCK_STEP=str(self._clocks),
        )
        ready = self.client.wait(self._is_ready, START_S) and self.running
        assert ready, f'the cell is not up: {self.log}'
        self._truth = TruthReader(self.live_folder.truth)
        if self.home_switch:
            success, answer = self.client.trigger('turntable/home')
            assert success, answer

    def options(self) -> list[str]:
        """Return the options of ``ivfmc up``."""
        switch = ['--home-switch'] if self.home_switch else []
        return [*small_cell_options(self._folder), *switch, '--part', str(self._part_file())]

    @property
    def live_folder(self) -> LiveFolder:
        """Folder of the simulated hardware."""
        return LiveFolder(self._folder / f'cell_{self.restarts:03d}' / 'simulation')

    def _part_file(self) -> Path:
        path = self._folder / f'{_PART}.stl'
        if not path.exists():
            part = part_called(_PART)
            write_solid(path, part.vertices_xyz, part.faces)
        return path

    def _is_ready(self) -> bool:
        if not self.running:
            # ends the wait
            return True
        camera = 'publishing' in self.client.diagnostic('camera')
        table = self.client.diagnostic('turntable')
        known = all(self.client.diagnostic(node) for node in NODES)
        connected = 'position' in table and 'connecting' not in table
        return bool(self.client.states) and known and camera and connected

    def end(self) -> None:
        """End the cell, and count what it leaves."""
        cell, self._cell = self._cell, None
        if cell is None:
            return
        if cell.up.poll() is None:
            self.resume_processes()
            try:
                cell.end(seconds=60.0)
            except subprocess.TimeoutExpired:
                self.orphans += 1
                cell.up.kill()
        if not gone(cell, 20.0):
            left = cell.processes()
            self.orphans += len(left)
            for pid in left:
                os.kill(pid, signal.SIGKILL)

    def kill(self) -> None:
        """Kill all processes of the cell."""
        cell, self._cell = self._cell, None
        if cell is not None:
            cell.kill()

    def processes(self) -> set[int]:
        """Return the process ids of the cell, those of helpers included."""
        return self._cell.processes() if self._cell else set()

    def find_processes(self) -> None:
        """Look up the ids of the nodes; those that were started again have others."""
        if self._cell is not None:
            self._pids = {node: self._cell.id_of(node) for node in NODES}

    def signal(self, node: str, number: int) -> None:
        """Send a signal to a node."""
        os.kill(self._pids[node], number)

    def signal_all(self, number: int) -> None:
        """Send a signal to ``ivfmc up``, then to every node."""
        assert self._cell is not None
        for pid in (self._cell.up.pid, *self._pids.values()):
            os.kill(pid, number)

    def resume_processes(self) -> list[str]:
        """Continue the nodes that are stopped; returns their names."""
        stopped = [node for node, pid in self._pids.items() if _is_stopped(pid)]
        for node in stopped:
            os.kill(self._pids[node], signal.SIGCONT)
        return stopped

    # -- faults of the simulated hardware, and of the clocks

    def controller_fault(self, text: str) -> None:
        """Cause a fault of the motion controller, see ControllerEmulator.fault."""
        with self.live_folder.faults.open('w', encoding='utf-8') as pipe:
            pipe.write(f'{text}\n')

    def camera_fault(self, text: str) -> None:
        """Cause a fault of the camera, see LiveFolder; '' ends it."""
        write_text(self.live_folder.camera_fault, text)

    def set_clock(self, seconds: float, whose: str = 'all') -> None:
        """Set the wall clock of all processes, or of one node, by ``seconds``."""
        path = self._clocks / whose
        with path.open('r+b') as stream:
            before = struct.unpack('d', stream.read(8))[0]
            stream.seek(0)
            stream.write(struct.pack('d', before + seconds))

    def reset_clocks(self) -> None:
        """Let all clocks agree again."""
        for path in self._clocks.iterdir():
            with path.open('r+b') as stream:
                stream.write(struct.pack('d', 0.0))

    def stall_camera(self, seconds: float) -> None:
        """Let the camera take no image for a while: one long frame period."""
        assert self.client.set('camera', frame_rate=1.0 / seconds).successful
        # the period begins with the next image
        self.client.spin(0.3)
        assert self.client.set('camera', frame_rate=15.0).successful

    # -- what is measured

    def table_speed(self) -> float:
        """Return the true speed of the table, rad/s."""
        return abs(self._truth.table_state(time.monotonic())[1]) if self._truth else 0.0

    def lit(self) -> bool:
        """Whether a laser shines."""
        now = time.monotonic()
        return bool(self._truth and self._truth.mean_laser_powers(now - 0.01, now).any())

    def beam_off_after(self, begin_s: float) -> float:
        """Return the seconds from ``begin_s`` until all lasers were off for good; inf if not."""
        if self._truth is None:
            return math.nan
        now = time.monotonic()

        def lit_since(second: float) -> bool:
            return bool(self._truth and self._truth.mean_laser_powers(second, now).any())

        if self.lit():
            return math.inf
        if not lit_since(begin_s):
            return 0.0
        low, high = begin_s, now
        while high - low > _RESOLUTION_S:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if lit_since(middle) else (low, middle)
        return high - begin_s

    def lost_profiles(self, scan_id: str, acknowledged: int) -> int:
        """Return how many profiles up to the acknowledged one are not in the bag; -1: none was."""
        # a recording that is being closed has its name changed
        self.client.wait((self.scans / scan_id / 'metadata.yaml').exists, _CLOSING_S)
        try:
            bag = open_bag(self.scans / scan_id, salvage=True)
            topic = f'{self.client.node.get_namespace()}/profile'
            if topic not in bag.topics:
                return acknowledged + 1
            seqs = {header.seq for header in recorded_profile_headers(bag, topic).values()}
        except (BagError, FileError):
            return acknowledged + 1
        return len(set(range(acknowledged + 1)) - seqs)

    def share_off(self, scan_id: str) -> float:
        """Return the share of the points of a scan beyond their stated uncertainty."""
        bag = open_bag(self.scans / scan_id)
        topic = f'{self.client.node.get_namespace()}/cloud'
        decode = bag.decoder(topic)
        clouds = [decode(raw) for raw in bag.messages([topic])]
        names = ('x', 'y', 'z', 'sigma')
        records = to_structured_array(clouds[-1], 'cloud', names).ravel()[::_STRIDE]
        points = np.stack([records[name] for name in names[:3]], axis=1).astype(np.float64)
        sigma = records['sigma'].astype(np.float64)
        # slips of this scan and of former ones have turned the whole part
        part = part_called(_PART)
        return share_off(points, sigma, part, likely_turns(points, sigma, part))


def _is_stopped(pid: int) -> bool:
    try:
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] == 'T'
    except (OSError, IndexError):
        return False
