# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The stripe of the measured scan: a cell, the bare platter, and a sheet to look at."""

from pathlib import Path
import subprocess
import sys
import tempfile

import cv2
import numpy as np

from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.model import Frame
from ivfmc_ros.pictures import list_pictures
from ivfmc_ros.pictures import read_picture
from ivfmc_ros.stripe.acquisition import Acquisition
from ivfmc_ros.stripe.acquisition import AcquisitionSettings
from ivfmc_ros.stripe.extract import ExtractSettings

SHEET = Path('build/bench/stripes.png')
PART = Volume(radius=0.075, bottom=0.002, top=0.16)
PLATTER = Volume(radius=0.09, bottom=-0.006, top=0.006)
_ROOT = Path(__file__).resolve().parents[2]


def calibrated(data):
    """Return the cell, calibrated from the pictures alone."""
    board = ('--board', 'chessboard:8x6:40mm')
    with tempfile.TemporaryDirectory() as folder:
        camera, cell = Path(folder) / 'camera.yaml', Path(folder) / 'cell.yaml'
        files = ('--camera', str(camera), '--cell', str(cell))
        _ivfmc('camera', str(data / 'chessboard'), *board, '-o', str(camera))
        _ivfmc('laser', str(data / 'chessboard_laser'), *board, *files)
        _ivfmc('turntable', str(data / 'object'), '--markers', 'DICT_4X4_50:30mm', *files,
               '--stripe-pictures', str(data / 'empty_table'))  # fmt: skip
        return load_draft(cell).complete(load_camera(camera), str(cell))


def _ivfmc(*arguments):
    command = [sys.executable, '-m', 'ivfmc_ros.cli.main', 'calibrate', *arguments]
    done = subprocess.run(command, cwd=_ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f'calibrate {arguments[0]}: {done.stderr.strip()}')


def frames(folder):
    """Return the pictures of a folder."""
    return [
        Frame(image=read_picture(path), stamp_ns=seq, angle=0.0, seq=seq)
        for seq, path in enumerate(list_pictures(folder))
    ]


def platter_heights(cell, pictures, settings):
    """Return the heights (meters) of points over the platter's mean line, by picture and row."""
    acquisition = Acquisition(cell, AcquisitionSettings(extract=settings, volume=PLATTER))
    acquisition.resolve_auto_settings(pictures)
    profiles = [acquisition.profile(frame) for frame in pictures]
    points = np.concatenate([profile.points_xyz for profile in profiles])
    rows = [(profile.seq, row) for profile in profiles for row in profile.uv[:, 1]]
    # angle 0: the frame is turntable_base, and the platter is a line in it
    along = points[:, :2] @ _direction(points)
    inside = np.ones(len(points), dtype=bool)
    for _ in range(4):
        heights = points[:, 2] - np.polyval(np.polyfit(along[inside], points[inside, 2], 1), along)
        inside = np.abs(heights) < 3e-3
    return {rows[k]: heights[k] for k in np.flatnonzero(inside)}


def _direction(points):
    level = points[:, :2] - points[:, :2].mean(axis=0)
    return np.linalg.svd(level, full_matrices=False)[2][0]


def draw_sheet(cell, pictures, settings):
    """Write twelve pictures with the stripe that was found in them; return the points drawn."""
    acquisition = Acquisition(cell, AcquisitionSettings(extract=settings, volume=PART))
    acquisition.resolve_auto_settings(pictures)
    tiles, count = [], 0
    for frame in pictures:
        profile = acquisition.profile(frame)
        tile = cv2.resize(frame.image, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
        for u, v in np.rint(profile.uv * 2 + 0.5).astype(int):
            tile[v : v + 1, u - 1 : u + 2] = (255, 0, 255)
        tiles.append(tile[100:900, 300:1100])
        count += len(profile)
    rows = [np.hstack(tiles[first : first + 4]) for first in range(0, len(tiles), 4)]
    SHEET.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(SHEET), np.vstack(rows))
    return count


MASS = ExtractSettings(
    method='centre_of_mass', shape_uncertainty=False, path=False, max_error=50.0
)
