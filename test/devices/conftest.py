# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from collections.abc import Iterator
from pathlib import Path

import pytest

from ivfmc_ros.devices.grbl.controller import GrblController
from ivfmc_ros.devices.settings import ControllerSettings
from ivfmc_ros.simulation.controller_emulator import ControllerEmulator


@pytest.fixture
def emulator(tmp_path: Path) -> Iterator[ControllerEmulator]:
    emulator = ControllerEmulator(tmp_path / 'controller', seed=1)
    emulator.start()
    yield emulator
    emulator.stop()


@pytest.fixture
def controller(emulator: ControllerEmulator, tmp_path: Path) -> Iterator[GrblController]:
    controller = GrblController(
        ControllerSettings(
            port=str(tmp_path / 'controller'), lasers={'left': 'spindle', 'right': 'coolant'}
        )
    )
    controller.open()
    yield controller
    controller.close()
