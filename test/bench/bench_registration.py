# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Registration: cells and tables that err, parts that do not hold, bunny, clampings, cost.

Stripes are exact crossings of sheet and CAD with 0.08 px of noise, one set a part for all seeds;
the seeds err: table, axis, laser plane, slips. One scan goes through rendered pictures.
"""

from collections.abc import Iterator

import numpy as np
from registration_bunny import bunny
from registration_cost import cost
from registration_merge import merging
from registration_scans import best_fit_rms
from registration_scans import Errors
from registration_scans import Recording
from registration_scans import share_left

from bench import at_least
from bench import at_most
from bench import Number
from erring_table import rendered_views
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.registration.align import align
from ivfmc_ros.registration.prior import TablePrior
from ivfmc_ros.registration.refine import refine
from ivfmc_ros.registration.refine import Refined
from ivfmc_ros.simulation.bench import axial_plane
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts import box
from ivfmc_ros.simulation.parts import cylinder
from ivfmc_ros.simulation.parts import demo_part
from ivfmc_ros.simulation.parts import plate
from ivfmc_ros.simulation.parts import sphere
from ivfmc_ros.simulation.solids import Solid
