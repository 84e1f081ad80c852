# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Causes a fault in a scan of a cell of real processes, and measures what comes of it."""

from collections.abc import Callable
from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field
import math
import time
from typing import Any
from typing import NamedTuple

from support.fault_cell import FaultCell
from support.fault_cell import SCAN_S

# Short scans: 80 profiles in 7 s; the slips need profiles that are less than 4.6 degrees apart.
SHORT: Mapping[str, Any] = {
    'motion': 'continuous',
    'profiles': 80,
    'profile_rate': 13.0,
    'lasers': ['left'],
    'home': False,
}
FINE: Mapping[str, Any] = {**SHORT, 'profiles': 140, 'profile_rate': 12.0}
FINE_TWO: Mapping[str, Any] = {**FINE, 'lasers': ['left', 'right']}
# Share of the points beyond their stated uncertainty above that of a scan without a fault from
# which a shape is wrong, and the number of those: they begin at other angles, and 70 of them had
# shares of 0.8 to 4.2 %.
_WRONG_SHARE, _BASELINES = 0.02, 6
# Seconds after the end of a scan in which the beam has to stay off.
_AFTER_S = 0.6
# Seconds after a fault in which the beam may go off; later it counts as on.
_BEAM_S = 1.5
# clear_alarm is tried so often: a controller needs a moment after its port is back.
_ATTEMPTS = 5
# Seconds that a camera which was plugged in again may take to publish.
_CAMERA_S = 20.0
# A table that turns in a sweep or in homing is faster than this, rad/s.
_TURNS = 0.15
# Profiles that are on disk before a fault in the middle of a scan.
_SOME = 5
# ... and in the middle of a sweep, well after the table has reached its speed: what happens before
# only turns the whole part ...
_MIDDLE = 50
# ... and near the end of a short one, those at standstill and in the lead-in included.
_LAST = 80


@dataclass(frozen=True, kw_only=True)
class FaultCase:
    """
    One fault.

    stage : of the scan, see ``reach``
    cause : causes it
    request : parameters of the scan
    plug : the cable of the controller is plugged in again before the next scan
    hazard : the beam or the table is out of control from the fault on, so that the beam has to be
        off within a second of the fault; else within a second of its detection
    """

    name: str
    stage: str
    cause: Callable[[FaultCell], object]
    request: Mapping[str, Any] = field(default_factory=lambda: SHORT)
    plug: bool = False
    hazard: bool = False


class Effect(NamedTuple):
    """
    What a fault did.

    code, detail : of the scan, '' where nothing was said
    detected_s : from the fault to the result that says it; NaN for a scan that is OK
    beam_off_s : from the fault until the beam was off for good; NaN for a scan that is OK
    lost : acknowledged profiles that are not in the bag
    wrong : the scan says OK and its shape is off by more than its uncertainty
    next_code : of the next scan; 'OK' where it is good
    down : ``ivfmc up`` took the cell down
    repairs : what was done before the next scan
    with_result : the scan ran to its end, and its result says what is wrong: a slip shows only
        where surface is measured a second time
    """

    fault: str
    stage: str
    code: str
    detail: str
    detected_s: float = math.nan
    beam_off_s: float = math.nan
    lost: int = 0
    wrong: bool = False
    next_code: str = ''
    down: bool = False
    repairs: str = ''
    hazard: bool = False
    with_result: bool = False

    @property
    def stopped(self) -> bool:
        """Whether the fault ended the scan before its result."""
        return self.code != 'OK' and not self.with_result

    @property
    def next_scan(self) -> str:
        """What the table says of the next scan."""
        if self.next_code != 'OK':
            return f'no: {self.next_code}'
        return f'good, after: {self.repairs}' if self.repairs else 'good'


class Baselines:
    """Shares of points beyond their uncertainty in scans without a fault, by their parameters."""

    def __init__(self, cell: FaultCell) -> None:
        self._cell, self._shares = cell, dict[str, float]()

    def take(self, request: Mapping[str, Any]) -> None:
        """Scan with these parameters unless that was done."""
        key = _key(request)
        if key not in self._shares:
            self._shares[key] = max(self._share(request) for _ in range(_BASELINES))

    def _share(self, request: Mapping[str, Any]) -> float:
        """Return the share of a scan without a fault."""
        self._cell.ensure()
        scan_id = start(self._cell, request)
        code = await_result(self._cell, scan_id)
        assert code == 'OK', f'{code} without a fault: {self._cell.log}'
        return self._cell.share_off(scan_id)

    def is_wrong(self, scan_id: str, request: Mapping[str, Any]) -> bool:
        """Whether a scan has more points beyond their uncertainty than one without a fault."""
        more = self._cell.share_off(scan_id) - self._shares[_key(request)]
        return more > _WRONG_SHARE


def _key(request: Mapping[str, Any]) -> str:
    return f'{request["profiles"]} {request["lasers"]}'


def start(cell: FaultCell, request: Mapping[str, Any]) -> str:
    """Start a scan; returns its id."""
    result = cell.client.set('orchestrator', **request)
    assert result.successful, result.reason
    success, answer = cell.client.trigger('start_scan')
    assert success, answer
    return str(answer['scan_id'])


def await_result(cell: FaultCell, scan_id: str) -> str:
    """Return the code of a scan when it has ended, '' if nothing said so."""
    client = cell.client
    client.wait(lambda: client.result(scan_id) or not cell.running, SCAN_S)
    # the last words of a cell that ends
    client.wait(lambda: client.result(scan_id), 2.0)
    found = client.result(scan_id)
    return str(found[1]['code']) if found else ''


def reach(cell: FaultCell, scan_id: str, stage: str) -> bool:
    """Wait for a stage of a scan; False if the scan ends before."""
    client, begin_s = cell.client, time.monotonic()

    def has(name: str) -> bool:
        return client.state(scan_id).get('stage') == name

    def written() -> int:
        return max((count for when, count in client.counts if when > begin_s), default=-1)

    def sweeping(profiles: int) -> bool:
        turns = cell.table_speed() > _TURNS
        return has('SCANNING') and cell.lit() and turns and written() >= profiles

    reached = {
        'starting': lambda: True,
        'homing': lambda: has('PREPARING') and cell.table_speed() > _TURNS and not cell.lit(),
        'scanning': lambda: sweeping(_SOME),
        'mid-sweep': lambda: sweeping(_MIDDLE),
        'last profiles': lambda: has('SCANNING') and written() >= _LAST,
        'registering': lambda: has('REGISTERING'),
        'meshing': lambda: has('MESHING'),
        'finishing': lambda: has('FINISHING'),
    }[stage]
    client.wait(lambda: reached() or client.result(scan_id) or not cell.running, SCAN_S)
    return bool(reached())


def run_case(cell: FaultCell, baselines: Baselines, case: FaultCase) -> Effect:
    """Scan with a fault, then without one."""
    cell.ensure()
    if _has_fault(cell.client.diagnostic('turntable')):
        # left by the case before, whose row says that the next scan was not good
        repair(cell, plug=True)
    baselines.take(case.request)
    cell.find_processes()
    start_s = time.monotonic()
    scan_id = start(cell, case.request)
    if not reach(cell, scan_id, case.stage):
        code = await_result(cell, scan_id)
        return Effect(case.name, case.stage, code, f'{case.stage} was not reached')
    begin_s = time.monotonic()
    case.cause(cell)
    effect = observe(cell, baselines, scan_id, case.request, start_s, begin_s)
    repairs = repair(cell, plug=case.plug)
    return effect._replace(
        fault=case.name,
        stage=case.stage,
        hazard=case.hazard,
        repairs=', '.join(repairs),
        next_code=next_code(cell, baselines),
    )


def observe(
    cell: FaultCell,
    baselines: Baselines,
    scan_id: str,
    request: Mapping[str, Any],
    start_s: float,
    begin_s: float,
) -> Effect:
    """Return what became of a scan with a fault at the steady second ``begin_s``."""
    client = cell.client
    code = await_result(cell, scan_id)
    # the end may be known before the beam goes off
    client.wait(lambda: False, max(_AFTER_S, begin_s + _BEAM_S - time.monotonic()))
    found = client.result(scan_id)
    detail = str(found[1].get('detail', '')) if found else 'no result was published'
    ended = code != 'OK'
    acknowledged = max((count for when, count in client.counts if when > start_s), default=-1)
    return Effect(
        fault='',
        stage='',
        code=code,
        detail=detail,
        detected_s=(found[0] - begin_s if found else math.inf) if ended else math.nan,
        beam_off_s=cell.beam_off_after(begin_s) if ended else math.nan,
        lost=cell.lost_profiles(scan_id, acknowledged),
        wrong=not ended and baselines.is_wrong(scan_id, request),
        down=not cell.running,
        with_result=bool(found and found[1].get('mesh')),
    )


def repair(cell: FaultCell, *, plug: bool) -> list[str]:
    """Do what a person has to do before the next scan; returns what it was."""
    client, done = cell.client, []
    if cell.running:
        # a line that loses bytes is a fault of one case
        cell.controller_fault('drop 0')
        cell.camera_fault('')
        done += [f'{node} was continued' for node in cell.resume_processes()]
        if plug:
            cell.controller_fault('plug')
            done.append('the cable was plugged in')
    else:
        done.append('the cell was started again')
    cell.ensure()
    cell.reset_clocks()
    # diagnostics come once a second
    client.wait(lambda: False, 1.2)
    client.wait(lambda: 'publishing' in client.diagnostic('camera'), _CAMERA_S)
    for _ in range(_ATTEMPTS):
        if not _has_fault(client.diagnostic('turntable')):
            break
        client.ask('turntable/clear_alarm', 30.0)
        done = [*done, 'clear_alarm'] if 'clear_alarm' not in done else done
        client.wait(lambda: False, 1.2)
    return done


def _has_fault(diagnostic: str) -> bool:
    """Whether the diagnostics of turntable have a code of the motion controller."""
    values = dict(item.partition(': ')[::2] for item in diagnostic.split(' | '))
    return bool(values.get('code', '').strip())


def next_code(cell: FaultCell, baselines: Baselines) -> str:
    """Scan without a fault; returns 'OK' if the scan is good, else what is wrong with it."""
    baselines.take(SHORT)
    scan_id = start(cell, SHORT)
    code = await_result(cell, scan_id)
    if code != 'OK':
        found = cell.client.result(scan_id)
        return f'{code}: {found[1].get("detail", "") if found else "no result"}'
    return 'a wrong shape' if baselines.is_wrong(scan_id, SHORT) else 'OK'
