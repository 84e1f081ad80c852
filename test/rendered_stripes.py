# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Stripes found in rendered pictures, kept on disk: rendering is most of what a bench would cost.

A file is named by all that its content depends on, the sources that render and extract included,
so that none is ever stale.
"""

from collections.abc import Sequence
import hashlib
from pathlib import Path

from erring_table import Sweep
import numpy as np

import ivfmc_ros
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.model import Floats
from ivfmc_ros.simulation.render import StripeRenderer
from ivfmc_ros.simulation.solids import Solid
from ivfmc_ros.stripe.acquisition import Acquisition
from ivfmc_ros.stripe.acquisition import AcquisitionSettings
from ivfmc_ros.stripe.stripe import Stripe
from ivfmc_ros.stripe.triangulate import sensitivity

KEPT = Path(__file__).resolve().parents[1] / 'build' / 'bench' / 'stripes'
_SOURCES = ('cell', 'simulation', 'stripe')
_PREPARED = 8  # pictures by which the extraction decides what its settings leave open


def rendered_stripes(
    cell: Cell, solid: Solid, sweeps: Sequence[Sweep], seed: int, folder: Path = KEPT
) -> list[list[Stripe]]:
    """Return what is found in a picture of each profile of each sweep, no platter in sight."""
    return [
        _kept(cell, solid.moved(sweep.slip), sweep.laser, sweep.true, seed + 1000 * number, folder)
        for number, sweep in enumerate(sweeps)
    ]


def _kept(
    cell: Cell, solid: Solid, laser: int, angles: Floats, seed: int, folder: Path
) -> list[Stripe]:
    file = folder / f'{_key(cell, solid, laser, angles, seed)}.npz'
    if not file.exists():
        found = _rendered(cell, solid, laser, angles, seed)
        folder.mkdir(parents=True, exist_ok=True)
        whole = file.with_suffix(f'.{seed}.part.npz')
        np.savez(
            whole,
            counts=[len(stripe) for stripe in found],
            **{
                name: np.concatenate([getattr(stripe, name) for stripe in found])
                for name in ('uv', 'intensity', 'width', 'sigma')
            },
        )
        whole.rename(file)
    with np.load(file) as arrays:
        ends = np.cumsum(arrays['counts'])[:-1]
        columns = {
            name: np.split(arrays[name], ends) for name in ('uv', 'intensity', 'width', 'sigma')
        }
    return [
        Stripe(**{name: parts[k] for name, parts in columns.items()}) for k in range(len(angles))
    ]


def _rendered(cell: Cell, solid: Solid, laser: int, angles: Floats, seed: int) -> list[Stripe]:
    renderer = StripeRenderer(cell=cell, solid=solid, platter=None, seed=seed)
    acquisition = Acquisition(cell, AcquisitionSettings())
    some = np.linspace(0, len(angles) - 1, _PREPARED).astype(int)
    acquisition.prepare([renderer.render(float(angles[k]), laser, seq=int(k)) for k in some])
    found = []
    for seq, angle in enumerate(angles):
        profile = acquisition.profile(renderer.render(float(angle), laser, seq=seq))
        slopes = sensitivity(cell, cell.lasers[laser], cell.camera.rays(profile.uv))
        found.append(
            Stripe(
                uv=profile.uv,
                intensity=profile.intensity,
                width=np.full(len(profile), 2.5),
                sigma=profile.sigma / np.linalg.norm(slopes, axis=1),
            )
        )
    return found


def _key(cell: Cell, solid: Solid, laser: int, angles: Floats, seed: int) -> str:
    digest = hashlib.sha256()
    package = Path(ivfmc_ros.__file__).parent
    for folder in _SOURCES:
        for source in sorted((package / folder).glob('*.py')):
            digest.update(source.read_bytes())
    plane = cell.lasers[laser]
    numbers = (
        cell.camera.K,
        cell.camera.distortion,
        cell.turntable.camera_from_base,
        np.append(plane.normal, plane.offset),
        solid.vertices_xyz,
        solid.faces,
        np.append(angles, (laser, seed)),
    )
    for values in numbers:
        digest.update(np.ascontiguousarray(values, dtype=np.float64).tobytes())
    return digest.hexdigest()[:24]
