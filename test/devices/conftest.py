# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from collections.abc import Iterator
from pathlib import Path

import pytest

from ivfmc_ros.devices.grbl.controller import GrblBoard
from ivfmc_ros.devices.grbl.settings import GrblSettings
from ivfmc_ros.simulation.grbl.emulator import BoardEmulator


@pytest.fixture
def emulator(tmp_path: Path) -> Iterator[BoardEmulator]:
    emulator = BoardEmulator(tmp_path / 'board', seed=1)
    emulator.start()
    yield emulator
    emulator.stop()


@pytest.fixture
def board(emulator: BoardEmulator, tmp_path: Path) -> Iterator[GrblBoard]:
    board = GrblBoard(
        GrblSettings(port=str(tmp_path / 'board'), lasers={'left': 'spindle', 'right': 'coolant'})
    )
    board.open()
    yield board
    board.close()
