# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Process that simulates the hardware of a cell: motion controller, table, two lasers, a part.

``python -m ivfmc_ros.simulation.live_cell --folder DIR`` runs until SIGINT or SIGTERM. The camera
is simulated by the camera node, which reads the same folder.
"""

import argparse
from collections.abc import Iterator
from collections.abc import Sequence
from contextlib import contextmanager
import fcntl
import math
import os
from pathlib import Path
import signal
import sys
import threading

from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.cell_file import load_cell
from ivfmc_ros.devices.motion.trajectory import Segment
from ivfmc_ros.devices.motion.trajectory import Trajectory
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.controller_emulator import ControllerEmulator
from ivfmc_ros.simulation.laser_outputs import LaserOutputs
from ivfmc_ros.simulation.live.folder import LiveDescription
from ivfmc_ros.simulation.live.folder import LiveFolder
from ivfmc_ros.simulation.live.truth import TruthWriter
from ivfmc_ros.simulation.parts.loading import load_stl
from ivfmc_ros.simulation.parts.loading import Solid
from ivfmc_ros.simulation.parts.solids import demo_part
from ivfmc_ros.simulation.render.optics import Optics
from ivfmc_ros.simulation.render.optics import with_sheet_thickness
from ivfmc_ros.simulation.trigger_line import TriggerLine

_RADIANS_PER_UNIT = math.pi / 180  # the controller counts degrees


@contextmanager
def live_cell(
    folder: LiveFolder,
    description: LiveDescription,
    *,
    homing: bool = False,
    clock_scale: float = 1.0,
) -> Iterator[ControllerEmulator]:
    """
    Simulate a cell in ``folder`` until the block ends, and remove its files then.

    homing : whether the table has a home switch; it is locked then until it is homed
    clock_scale : controller seconds per second
    :raises FileError: the folder cannot be written, or another process simulates a cell in it
    """
    with _exclusive_lock(folder.folder):
        folder.clear()
        try:
            folder.write(description)
            truth = TruthWriter(folder.truth)
            controller = ControllerEmulator(
                folder.controller,
                on_motion=lambda now, motion: truth.write_motion(now, _in_radians(motion)),
                on_outputs=lambda now, outputs: truth.write_lasers(now, _powers(outputs)),
                clock_scale=clock_scale,
                homing=homing,
                seed=description.seed,
            )
            step = description.cell.turntable.trigger_step / _RADIANS_PER_UNIT
            if step:
                line = TriggerLine(step, description.seed)
                controller.connect_trigger(line, truth.write_triggers)
            controller.start()
            try:
                with _fault_pipe(folder.faults, controller):
                    yield controller
            finally:
                controller.stop()
        finally:
            folder.clear()


@contextmanager
def _exclusive_lock(folder: Path) -> Iterator[None]:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder, os.O_RDONLY)
    except OSError as error:
        raise FileError(f'{folder}: cannot be created: {error.strerror}') from error
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    except BlockingIOError as error:
        raise FileError(f'{folder}: another process simulates a cell there') from error
    finally:
        os.close(handle)


@contextmanager
def _fault_pipe(path: Path, controller: ControllerEmulator) -> Iterator[None]:
    """Cause the faults that other processes write into a named pipe, one per line."""
    os.mkfifo(path)
    # opened for writing too: otherwise reading ends when a writer closes the pipe
    handle = os.open(path, os.O_RDWR)

    def read_faults() -> None:
        with os.fdopen(os.dup(handle), encoding='utf-8', errors='replace') as lines:
            for line in lines:
                if line.strip() == 'end':
                    return
                try:
                    controller.fault(line)
                except ValueError as error:
                    sys.stderr.write(f'live_cell: {error}\n')

    thread = threading.Thread(target=read_faults, name='faults', daemon=True)
    thread.start()
    try:
        yield
    finally:
        os.write(handle, b'end\n')
        thread.join()
        os.close(handle)


def _in_radians(motion: Trajectory) -> Trajectory:
    return tuple(
        Segment(
            time=segment.time,
            position=segment.position * _RADIANS_PER_UNIT,
            velocity=segment.velocity * _RADIANS_PER_UNIT,
            acceleration=segment.acceleration * _RADIANS_PER_UNIT,
        )
        for segment in motion
    )


def _powers(outputs: LaserOutputs) -> tuple[float, float]:
    """Return the powers of both lasers: the first is on spindle, the second on coolant."""
    return outputs.spindle, outputs.coolant


def _cell(options: argparse.Namespace) -> Cell:
    if options.cell is None and options.camera is None:
        return bench_cell()
    if options.cell is None or options.camera is None:
        raise ParameterError('--cell and --camera belong together')
    return load_cell(options.cell, load_camera(options.camera))


def _part(name: str, unit: str) -> Solid | None:
    if name == 'none':
        return None
    if name == 'demo':
        return demo_part()
    return load_stl(Path(name), unit)  # type: ignore[arg-type]


def _arguments(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='live_cell', description='Simulate the hardware of a cell.'
    )
    parser.add_argument(
        '--folder', type=Path, required=True, help='of the simulated cell, created if missing'
    )
    parser.add_argument('--cell', type=Path, help='cell.yaml (default: the bench cell)')
    parser.add_argument('--camera', type=Path, help='camera.yaml of that cell')
    parser.add_argument('--part', default='demo', help='demo, none, or an STL file')
    parser.add_argument('--unit', choices=('m', 'mm', 'inch'), default='mm', help='of the STL')
    parser.add_argument('--seed', type=int, default=0, help='of the image noise')
    parser.add_argument('--homing', action='store_true', help='simulate a home switch')
    parser.add_argument(
        '--clock-scale', type=float, default=1.0, help='controller seconds per second'
    )
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    """Simulate a cell until SIGINT or SIGTERM; write 'ready' to stdout when it runs."""
    options = _arguments(arguments)
    ending = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ending.set())
    try:
        description = LiveDescription(
            cell=with_sheet_thickness(_cell(options), Optics()),
            solid=_part(options.part, options.unit),
            optics=Optics(),
            seed=options.seed,
        )
        folder = LiveFolder(options.folder)
        with live_cell(
            folder, description, homing=options.homing, clock_scale=options.clock_scale
        ):
            sys.stdout.write('ready\n')
            sys.stdout.flush()
            # Python runs signal handlers between two waits only
            while not ending.wait(0.2):
                pass
    except ScanError as error:
        sys.stderr.write(f'live_cell: error: {error}\n')
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
