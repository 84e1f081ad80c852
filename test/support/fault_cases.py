# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The faults of the matrix: processes, controller, camera, clocks, and requests that collide."""

from collections.abc import Callable
from functools import partial
import signal
import time

from ivfmc_ros.cli.support.cell_run import NODES
from support.fault_cell import FaultCell
from support.fault_effects import FaultCase
from support.fault_effects import FINE
from support.fault_effects import FINE_TWO
from support.fault_effects import SHORT
from support.graph_rig import NodeProcess

STAGES = ('homing', 'scanning', 'registering', 'meshing')
SIGNALS = {'SIGKILL': signal.SIGKILL, 'SIGSTOP': signal.SIGSTOP}
# Without these, table and beam get no commands.
_IN_CONTROL = ('turntable', 'orchestrator')
_HOMED = {**SHORT, 'home': True}


def all_cases() -> list[FaultCase]:
    """Return the whole matrix; those that end the cell come last."""
    return [*measuring_cases(), *request_cases(), *controller_cases(), *process_cases()]


def process_cases() -> list[FaultCase]:
    """Each node killed and stopped in each stage."""
    return [
        FaultCase(
            name=f'{name} of {node}',
            stage=stage,
            cause=partial(FaultCell.signal, node=node, number=number),
            request=_HOMED if stage == 'homing' else SHORT,
            hazard=node in _IN_CONTROL and stage in ('homing', 'scanning'),
        )
        for stage in STAGES
        for node in NODES
        for name, number in SIGNALS.items()
    ]


def controller_cases() -> list[FaultCase]:
    """Alarm, reset, cable and silence of the motion controller, in mid-sweep and in homing."""
    texts = ('alarm 1', 'alarm 3', 'reset', 'unplug', 'silence 8')
    cases = [_controller(text, 'scanning') for text in texts]
    cases += [_controller(text, 'homing') for text in ('reset', 'unplug')]
    cases += [_controller(text, 'meshing') for text in ('alarm 1', 'unplug')]
    # the driver reads again what a damaged line said
    return [*cases, _controller('noise', 'scanning'), _controller('drop 0.02', 'scanning')]


def _controller(text: str, stage: str) -> FaultCase:
    return FaultCase(
        name=f'controller: {text}',
        stage=stage,
        cause=partial(FaultCell.controller_fault, text=text),
        request=_HOMED if stage == 'homing' else SHORT,
        plug=text == 'unplug',
        hazard=stage == 'scanning',
    )


def measuring_cases() -> list[FaultCase]:
    """Faults after which a scan could be OK and wrong: slips, stalls, clocks."""
    cases = [
        FaultCase(
            name=f'slip of {degrees} degrees, {len(request["lasers"])} laser(s)',
            stage='mid-sweep',
            cause=partial(FaultCell.controller_fault, text=f'slip {degrees}'),
            request=request,
        )
        for degrees, request in ((5.0, FINE), (-20.0, FINE), (-1.0, FINE_TWO), (5.0, FINE_TWO))
    ]
    cases += [
        FaultCase(
            name=f'camera without images for {seconds} s',
            stage='mid-sweep',
            cause=partial(FaultCell.stall_camera, seconds=seconds),
            request=FINE,
        )
        for seconds in (0.3, 1.6, 5.0)
    ]
    cases += [
        FaultCase(
            name=f'camera process stands for {seconds} s',
            stage='mid-sweep',
            cause=partial(frozen, 'camera', seconds),
            request=FINE,
        )
        for seconds in (0.5, 1.5)
    ]
    cases += [
        FaultCase(
            name=f'camera: {text}',
            stage='mid-sweep',
            cause=partial(FaultCell.camera_fault, text=text),
            request=FINE,
        )
        for text in ('unplug', 'freeze')
    ]
    return cases + [
        FaultCase(
            name=f'clock of {whose} set by {seconds:+g} s',
            stage='mid-sweep',
            cause=partial(FaultCell.set_clock, seconds=seconds, whose=whose),
            request=FINE if whose == 'all' else FINE_TWO,
        )
        for seconds, whose in (
            (3600.0, 'all'),
            (-3600.0, 'all'),
            (0.3, 'all'),
            (-0.3, 'camera'),
            (0.4, 'camera'),
            (0.4, 'turntable'),
        )
    ]


def request_cases() -> list[FaultCase]:
    """Second nodes, and requests in the wrong moment."""
    named: dict[str, tuple[str, Callable[[FaultCell], object]]] = {
        'second orchestrator': ('scanning', second_orchestrator),
        'second start_scan': ('scanning', refused_start),
        'recorder/start while it records': ('scanning', refused_recording),
        'turntable freezes for 1.3 s': ('scanning', partial(frozen, 'turntable', 1.3)),
    }
    return [
        FaultCase(name=name, stage=stage, cause=cause, hazard='turntable' in name)
        for name, (stage, cause) in named.items()
    ]


def frozen(node: str, seconds: float, cell: FaultCell) -> None:
    """Stop a process for a while; ``ivfmc up`` may kill it in the meantime."""
    cell.signal(node, signal.SIGSTOP)
    cell.client.wait(lambda: not cell.running, seconds)
    cell.resume_processes()


def second_orchestrator(cell: FaultCell) -> None:
    """Start another orchestrator in the namespace: it has to end by itself, and say why."""
    second = NodeProcess(
        'orchestrator',
        cell=str(cell.scans.parent / 'cell.yaml'),
        scan_root=str(cell.scans),
    )
    ended = cell.client.wait(lambda: not second.alive, 60.0)
    code = second.end()
    assert ended and code == 2, second.output
    assert 'runs already' in second.output


def refused_start(cell: FaultCell) -> None:
    """Ask for a second scan: it has to be refused as BUSY."""
    success, answer = cell.client.trigger('start_scan')
    assert not success and answer['code'] == 'BUSY', answer


def refused_recording(cell: FaultCell) -> None:
    """Ask the recorder for a second recording: it has to be refused as BUSY."""
    success, answer = cell.client.trigger('recorder/start')
    assert not success and answer['code'] == 'BUSY', answer


def start_while_recorder_closes(cell: FaultCell) -> None:
    """Record by hand, stop, and do not wait for that."""
    client, folder = cell.client, cell.scans / f'by_hand_{time.monotonic_ns()}'
    folder.mkdir(parents=True)
    values = {'scan_folder': str(folder), 'scan_id': folder.name, 'pictures': True}
    assert client.set('recorder', **values).successful
    success, answer = client.trigger('recorder/start')
    assert success, answer
    client.spin(1.5)
    client.send('recorder/stop')
