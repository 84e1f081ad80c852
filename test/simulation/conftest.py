# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the tests of the simulation share; the cell is costly because of its ray table."""

import numpy as np
import pytest

from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.solids import demo_part


@pytest.fixture(scope='session')
def cell():
    return bench_cell()


@pytest.fixture(scope='session')
def demo():
    return demo_part()


@pytest.fixture(scope='session')
def centroid_errors():
    """Pixels by which the center of mass of the light is off the truth, inside of a stripe."""

    def errors(light, truth, half=16):
        window = np.round(truth.across).astype(int)[:, None] + np.arange(-half, half + 1)
        weight = light[truth.line[:, None], window].astype(float)
        found = (weight * window).sum(axis=1) / weight.sum(axis=1)
        return found - truth.across

    return errors
