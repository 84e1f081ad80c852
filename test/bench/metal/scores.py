# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Errors of the points found in the pictures of a part, and how many of its rows are found."""

from collections.abc import Callable
from collections.abc import Iterable
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import open3d

from bench.metal import parts
from bench.metal import pictures
from bench.metal.path_tracer import PLATTER
from bench.metal.pictures import Shot
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Profile
from ivfmc_ros.simulation.render.scene import Scene

LIMIT = 0.1e-3  # meters, of a point that is right
FOUND_PIXELS = 1.5  # of a point from the directly lit stripe, across it
FAINT = 6.0  # DN, three sigmas of the read noise: less direct light is taken as not visible

Measure = Callable[[Shot, Sequence[Frame]], Profile]


@dataclass(frozen=True, eq=False, kw_only=True)
class Score:
    """
    What was found in pictures.

    distance, sigma : (n,) meters, of kept points from the CAD, and as claimed
    rows_found, rows_visible : (m,) bool, of all directly lit rows of the part: whether one point
        lies on the stripe, and whether its direct light is above the noise in one exposure
    crossings : of rows and stripe, more than rows where a row sees it on several surfaces
    """

    distance: Floats
    sigma: Floats
    rows_found: Bools
    rows_visible: Bools
    crossings: int

    @staticmethod
    def pooled(scores: Iterable['Score']) -> 'Score':
        """Return all scores as one."""
        names = ('distance', 'sigma', 'rows_found', 'rows_visible')
        scores = list(scores)
        joined = {name: np.concatenate([getattr(s, name) for s in scores]) for name in names}
        return Score(crossings=sum(s.crossings for s in scores), **joined)

    @property
    def share_off(self) -> float:
        """Share of the kept points that are off by more than the limit; NaN without points."""
        return float(np.mean(self.distance > LIMIT)) if len(self.distance) else float('nan')

    @property
    def rms(self) -> float:
        """Root mean square distance of the kept points, meters; NaN without points."""
        return float(np.sqrt(np.mean(self.distance**2))) if len(self.distance) else float('nan')

    @property
    def within_two_sigma(self) -> float:
        """Share of the kept points whose distance is below two claimed sigmas."""
        if not len(self.distance):
            return float('nan')
        return float(np.mean(self.distance < 2 * self.sigma))

    @property
    def found(self) -> float:
        """Share of the visible rows that are found."""
        return float(np.mean(self.rows_found[self.rows_visible]))

    @property
    def found_of_all(self) -> float:
        """Share of all directly lit rows that are found, the dark ones included."""
        return float(np.mean(self.rows_found))


def score(shots: Sequence[Shot], measure: Measure, exposures: Sequence[float] = (1.0,)) -> Score:
    """Return what ``measure`` makes of the shots of one part at the given exposures."""
    factor = pictures.exposure(shots)
    found = []
    for shot in shots:
        frames = list(pictures.frames(shot, factor, exposures))
        found.append(_compared(shot, factor, measure(shot, frames)))
    return Score.pooled(found)


def distances(shot: Shot, points_xyz: Floats) -> Floats:
    """Return the distances of points in ``turntable`` from part and platter, meters."""
    scene = Scene(getattr(parts, shot.part)(), PLATTER, 1.0)
    caster = open3d.t.geometry.RaycastingScene()
    caster.add_triangles(
        open3d.core.Tensor.from_numpy(scene.vertices_xyz.astype(np.float32)),
        open3d.core.Tensor.from_numpy(scene.faces.astype(np.uint32)),
    )
    query = open3d.core.Tensor.from_numpy(points_xyz.astype(np.float32))
    return np.asarray(caster.compute_distance(query).numpy(), dtype=np.float64)


def _compared(shot: Shot, factor: float, profile: Profile) -> Score:
    truth = pictures.truth(shot)
    lines, places = truth.line[truth.on_part], truth.across[truth.on_part]
    row = np.rint(profile.uv[:, 1]).astype(int)
    per_row: dict[int, list[float]] = {}
    for line, across in zip(row.tolist(), profile.uv[:, 0].tolist(), strict=True):
        per_row.setdefault(line, []).append(across)
    hit = [
        any(abs(u - across) < FOUND_PIXELS for u in per_row.get(line, ()))
        for line, across in zip(lines.tolist(), places.tolist(), strict=True)
    ]
    direct = pictures.linear(shot)[0] * factor
    width = direct.shape[1]
    column = np.clip(np.rint(places).astype(int), 1, width - 2)
    peak = np.max([direct[lines, column + k] for k in (-1, 0, 1)], axis=0)
    # a row may cross the stripe on several surfaces; it gives one point
    _, row_of = np.unique(lines, return_inverse=True)
    counts = [np.bincount(row_of, weights=mask) for mask in (hit, peak > FAINT)]
    return Score(
        distance=distances(shot, profile.points_xyz),
        sigma=profile.sigma,
        rows_found=counts[0] > 0,
        rows_visible=counts[1] > 0,
        crossings=len(hit),
    )
