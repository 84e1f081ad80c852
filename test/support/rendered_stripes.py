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
from typing import NamedTuple

import numpy as np

import ivfmc_ros
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.model import Floats
from ivfmc_ros.simulation.parts.loading import Solid
from ivfmc_ros.simulation.render.renderer import StripeRenderer
from ivfmc_ros.stripe.acquisition import Acquisition
from ivfmc_ros.stripe.acquisition import AcquisitionSettings
from ivfmc_ros.stripe.stripe import Stripe
from ivfmc_ros.stripe.triangulate import sensitivity
from support.erring_table import Sweep

KEPT = Path(__file__).resolve().parents[2] / 'build' / 'bench' / 'stripes'
_SOURCES = ('cell', 'simulation', 'stripe')
_PREPARED = 8  # pictures by which the extraction decides what its settings leave open
_FIELDS = ('uv', 'intensity', 'width', 'sigma')


class Job(NamedTuple):
    """Pictures of one laser on a solid as it stands at table angle 0, no platter in sight."""

    cell: Cell
    solid: Solid
    laser: int
    angles: Floats
    seed: int

    @property
    def name(self) -> str:
        """A name for all that the stripes depend on."""
        digest = hashlib.sha256()
        package = Path(ivfmc_ros.__file__).parent
        for folder in _SOURCES:
            for source in sorted((package / folder).rglob('*.py')):
                digest.update(source.read_bytes())
        plane = self.cell.lasers[self.laser]
        numbers = (
            self.cell.camera.K,
            self.cell.camera.distortion,
            self.cell.turntable.camera_from_base,
            np.append(plane.normal, plane.offset),
            self.solid.vertices_xyz,
            self.solid.faces,
            np.append(self.angles, (self.laser, self.seed)),
        )
        for values in numbers:
            digest.update(np.ascontiguousarray(values, dtype=np.float64).tobytes())
        return digest.hexdigest()[:24]


def jobs_of(cell: Cell, solid: Solid, sweeps: Sequence[Sweep], seed: int) -> list[Job]:
    """Return what is to be rendered for each sweep."""
    return [
        Job(cell, solid.moved(sweep.slip), sweep.laser, sweep.true, seed + 1000 * number)
        for number, sweep in enumerate(sweeps)
    ]


def rendered_stripes(
    cell: Cell, solid: Solid, sweeps: Sequence[Sweep], seed: int
) -> list[list[Stripe]]:
    """Return what is found in a picture of each profile of each sweep."""
    return [stripes_of(job) for job in jobs_of(cell, solid, sweeps, seed)]


def render(job: Job, folder: Path = KEPT) -> None:
    """Have the stripes of a job on disk."""
    file = folder / f'{job.name}.npz'
    if file.exists():
        return
    found = _rendered(job)
    columns = {name: np.concatenate([getattr(s, name) for s in found]) for name in _FIELDS}
    folder.mkdir(parents=True, exist_ok=True)
    part = file.with_suffix('.part.npz')
    np.savez(part, counts=[len(stripe) for stripe in found], **columns)
    part.rename(file)


def stripes_of(job: Job, folder: Path = KEPT) -> list[Stripe]:
    """Return the stripe of each picture of a job."""
    render(job, folder)
    with np.load(folder / f'{job.name}.npz') as arrays:
        ends = np.cumsum(arrays['counts'])[:-1]
        columns = [np.split(arrays[name], ends) for name in _FIELDS]
    return [
        Stripe(**dict(zip(_FIELDS, values, strict=True))) for values in zip(*columns, strict=True)
    ]


def _rendered(job: Job) -> list[Stripe]:
    cell, laser = job.cell, job.cell.lasers[job.laser]
    renderer = StripeRenderer(cell=cell, solid=job.solid, platter=None, seed=job.seed)
    acquisition = Acquisition(cell, AcquisitionSettings())
    some = np.linspace(0, len(job.angles) - 1, _PREPARED).astype(int)
    acquisition.resolve_auto_settings(
        [renderer.render(float(job.angles[k]), job.laser, seq=int(k)) for k in some]
    )
    found = []
    for seq, angle in enumerate(job.angles):
        profile = acquisition.profile(renderer.render(float(angle), job.laser, seq=seq))
        slopes = sensitivity(cell, laser, cell.camera.rays(profile.uv))
        found.append(
            Stripe(
                uv=profile.uv,
                intensity=profile.intensity,
                width=np.full(len(profile), np.nan),  # of no use to a triangulation
                sigma=profile.sigma / np.linalg.norm(slopes, axis=1),
            )
        )
    return found
