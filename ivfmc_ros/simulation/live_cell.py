# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A process that is the hardware of a cell: motion board with table and two lasers, and a part.

``python -m ivfmc_ros.simulation.live_cell --folder DIR`` serves until it is told to end.
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

from ivfmc_ros.devices.motion.ramp import Motion
from ivfmc_ros.devices.motion.ramp import Piece
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.grbl.emulator import BoardEmulator
from ivfmc_ros.simulation.grbl.modes import Outputs
from ivfmc_ros.simulation.live.folder import LiveDescription
from ivfmc_ros.simulation.live.folder import LiveFolder
from ivfmc_ros.simulation.live.truth import TruthWriter
from ivfmc_ros.simulation.parts.loading import load_stl
from ivfmc_ros.simulation.parts.loading import Solid
from ivfmc_ros.simulation.parts.solids import demo_part
from ivfmc_ros.simulation.render.optics import Optics
from ivfmc_ros.simulation.render.optics import with_thickness

_DEGREE = math.pi / 180


@contextmanager
def live_cell(
    folder: LiveFolder,
    description: LiveDescription,
    *,
    homing: bool = False,
    clock_scale: float = 1.0,
) -> Iterator[BoardEmulator]:
    """
    Serve a cell in ``folder`` until the block ends; then nothing of it is left there.

    homing : the table has a home switch, and is locked until it was homed
    clock_scale : board seconds in a second
    :raises FileError: the folder cannot be written, or another process serves a cell in it
    """
    with _only_one(folder.folder):
        folder.clear()
        try:
            folder.write(description)
            truth = TruthWriter(folder.truth)
            board = BoardEmulator(
                folder.board,
                on_motion=lambda now, motion: truth.motion(now, _in_radians(motion)),
                on_outputs=lambda now, outputs: truth.lasers(now, _powers(outputs)),
                clock_scale=clock_scale,
                homing=homing,
                seed=description.seed,
            )
            board.start()
            try:
                with _faults(folder.faults, board):
                    yield board
            finally:
                board.stop()
        finally:
            folder.clear()


@contextmanager
def _only_one(folder: Path) -> Iterator[None]:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder, os.O_RDONLY)
    except OSError as error:
        raise FileError(f'{folder}: cannot be made: {error.strerror}') from error
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    except BlockingIOError as error:
        raise FileError(f'{folder}: another process serves a simulated cell there') from error
    finally:
        os.close(handle)


@contextmanager
def _faults(path: Path, board: BoardEmulator) -> Iterator[None]:
    """Take faults from a named pipe, so that a test of other processes can cause them."""
    os.mkfifo(path)
    # opened for writing too, so that it does not end when a writer does
    handle = os.open(path, os.O_RDWR)

    def listen() -> None:
        with os.fdopen(os.dup(handle), encoding='utf-8', errors='replace') as lines:
            for line in lines:
                if line.strip() == 'end':
                    return
                try:
                    board.fault(line)
                except ValueError as error:
                    sys.stderr.write(f'live_cell: {error}\n')

    thread = threading.Thread(target=listen, name='faults', daemon=True)
    thread.start()
    try:
        yield
    finally:
        os.write(handle, b'end\n')
        thread.join()
        os.close(handle)


def _in_radians(motion: Motion) -> Motion:
    return tuple(
        Piece(
            time=piece.time,
            position=piece.position * _DEGREE,
            velocity=piece.velocity * _DEGREE,
            acceleration=piece.acceleration * _DEGREE,
        )
        for piece in motion
    )


def _powers(outputs: Outputs) -> tuple[float, float]:
    """Return the power of each laser: the first is wired to spindle, the second to coolant."""
    return outputs.spindle, outputs.coolant


def _part(name: str, unit: str) -> Solid | None:
    if name == 'none':
        return None
    if name == 'demo':
        return demo_part()
    return load_stl(Path(name), unit)  # type: ignore[arg-type]


def _arguments(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='live_cell', description='A cell without hardware.')
    parser.add_argument('--folder', type=Path, required=True, help='where processes meet')
    parser.add_argument('--part', default='demo', help='demo, none, or an STL file')
    parser.add_argument('--unit', choices=('m', 'mm', 'inch'), default='mm', help='of the STL')
    parser.add_argument('--seed', type=int, default=0, help='of the noise')
    parser.add_argument('--homing', action='store_true', help='the table has a home switch')
    parser.add_argument('--clock-scale', type=float, default=1.0, help='board seconds in a second')
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve a cell until SIGINT or SIGTERM; says 'ready' when it is up."""
    options = _arguments(arguments)
    ending = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ending.set())
    try:
        description = LiveDescription(
            cell=with_thickness(bench_cell(), Optics()),
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
            # a signal ends a wait only between two of them
            while not ending.wait(0.2):
                pass
    except ScanError as error:
        sys.stderr.write(f'live_cell: error: {error}\n')
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
