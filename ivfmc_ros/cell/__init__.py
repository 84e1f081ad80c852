# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Calibration model of a cell: camera, laser planes and turntable axis, and their files.

All poses and planes are in ``camera_optical_frame``; ``Cell`` holds all that triangulation needs.
"""

from ivfmc_ros.cell.camera import Camera as Camera
from ivfmc_ros.cell.camera_file import load_camera as load_camera
from ivfmc_ros.cell.camera_file import save_camera as save_camera
from ivfmc_ros.cell.cell import Cell as Cell
from ivfmc_ros.cell.cell import Turntable as Turntable
from ivfmc_ros.cell.cell_file import load_cell as load_cell
from ivfmc_ros.cell.cell_file import save_cell as save_cell
from ivfmc_ros.cell.covariance import CellCovariance as CellCovariance
from ivfmc_ros.cell.laser import LaserPlane as LaserPlane
