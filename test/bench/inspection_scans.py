# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Rendered scans for the bench of the inspection, kept in build/bench/scans between runs.

A part is placed by the seed: turned about the table axis by any angle, and shifted by up to 2 mm.
The pictures are rendered with the true bench cell; the points are triangulated with a cell whose
calibration errs within its stated covariance.
"""

from collections.abc import Sequence
from dataclasses import replace
import hashlib
from pathlib import Path
import pickle

import numpy as np
from support.cylinder_scan import with_random_errors

from bench.runner import RESULTS
from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.inspection.mesh_file import MeshBody
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Mesh
from ivfmc_ros.model import Profile
from ivfmc_ros.pipeline import measure_profiles
from ivfmc_ros.pipeline import reconstruct_profiles
from ivfmc_ros.pipeline import Settings
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.loading import Solid
from ivfmc_ros.simulation.render.optics import Optics
from ivfmc_ros.simulation.render.optics import with_sheet_thickness
from ivfmc_ros.simulation.render.renderer import simulate_scan
from ivfmc_ros.stripe.acquisition import AcquisitionSettings
from ivfmc_ros.stripe.stripe import Stripe
from ivfmc_ros.stripe.triangulate import triangulate

CACHE = RESULTS / 'scans'
# Pictures a turn, for each laser.
STEPS = 200
_SHIFT = 2e-3  # meters, of the part from the table axis
# 1 sigma of the calibration, meters and radians: translation and rotation of the axis; normal
# and offset of a laser plane. With it, diameters have U = 0.03 mm (k = 2).
_POSE = np.array([3e-6, 3e-6, 5e-6, 1e-5, 1e-5, 1e-5])
_PLANE = np.array([1e-5, 1e-5, 1e-5, 4e-6])
SETTINGS = Settings(acquisition=AcquisitionSettings(volume=Volume(bottom=0.5e-3)))


def true_cell() -> Cell:
    """Return the bench cell with the covariances of a good calibration."""
    cell = with_sheet_thickness(bench_cell(), Optics())
    lasers = []
    for laser in cell.lasers:
        across = np.eye(4)
        across[:3, :3] -= np.outer(laser.normal, laser.normal)
        lasers.append(replace(laser, covariance=across @ np.diag(_PLANE**2) @ across.T))
    turntable = replace(cell.turntable, covariance=np.diag(_POSE**2))
    return replace(cell, turntable=turntable, lasers=tuple(lasers))


def believed_cell(seed: int) -> Cell:
    """Return the cell of a calibration that errs within its covariance."""
    return with_random_errors(true_cell(), np.random.default_rng((seed, 1)))


def placement(seed: int) -> Floats:
    """Return turntable_from_part, (4, 4)."""
    rng = np.random.default_rng((seed, 2))
    T = np.eye(4)
    T[:3, :3] = transforms.rotation_z(np.array([rng.uniform(0.0, 2.0 * np.pi)]))[0]
    T[:2, 3] = rng.uniform(-_SHIFT, _SHIFT, 2)
    return T


def profiles(name: str, part: Solid, seed: int) -> Sequence[Profile]:
    """
    Return the profiles of a scan, as the true cell measures them.

    name : of the part, which the cache files are named by
    """
    # a wrong part of one name may be wrong at another feature
    shape = hashlib.sha256(part.vertices_xyz.tobytes()).hexdigest()[:12]
    path = CACHE / f'{name.replace(" ", "_")}-{shape}-{seed}-{STEPS}.pickle'
    if path.is_file():
        with path.open('rb') as stream:
            return list(pickle.load(stream))
    cell = true_cell()
    frames = simulate_scan(cell, part.moved(placement(seed)), STEPS, seed=seed)
    found = measure_profiles(cell, frames, SETTINGS)
    write(path, found)
    return found


def write(path: Path, found: Sequence[Profile]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix('.part')
    with partial.open('wb') as stream:
        pickle.dump(found, stream)
    partial.rename(path)


def retriangulated(cell: Cell, found: Sequence[Profile]) -> list[Profile]:
    """Return profiles with the points that another cell sees at their pixels."""
    return [_retriangulated(cell, profile) for profile in found]


def _retriangulated(cell: Cell, profile: Profile) -> Profile:
    unknown = np.ones(len(profile))
    stripe = Stripe(uv=profile.uv, intensity=profile.intensity, width=unknown, sigma=unknown)
    frame = Frame(
        image=np.zeros((1, 1), dtype=np.uint8),
        stamp_ns=profile.stamp_ns,
        angle=profile.angle,
        laser=profile.laser,
        view=profile.view,
        seq=profile.seq,
        speed=profile.speed,
    )
    again = triangulate(cell, frame, stripe)
    return replace(profile, points_xyz=again.points_xyz)


def mesh_of(name: str, part: Solid, seed: int) -> tuple[MeshBody, Cell]:
    """Return the mesh of a scan, and the cell that it was triangulated with."""
    cell = believed_cell(seed)
    found = retriangulated(cell, profiles(name, part, seed))
    return body(reconstruct_profiles(cell, found, SETTINGS).mesh), cell


def body(mesh: Mesh) -> MeshBody:
    return MeshBody(
        vertices_xyz=mesh.vertices_xyz,
        faces=mesh.faces,
        closed=False,
        sigma=mesh.sigma,
        systematic=mesh.systematic,
    )
