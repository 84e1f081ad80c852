# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sections of sweeps by table angle, and how well their surfels fit those of other times."""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace
from functools import cached_property
import math

import numpy as np
from scipy.spatial import cKDTree

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.registration.solver.downsample import common_voxel_size
from ivfmc_ros.registration.solver.downsample import downsample
from ivfmc_ros.registration.solver.surfels import concatenate_surfels
from ivfmc_ros.registration.solver.surfels import fit_surfels
from ivfmc_ros.registration.solver.surfels import Surfels

# Samples of each view that are compared.
_MAX_SAMPLES = 3000
# Width of a section, and its margin in which surfels are fitted but not used, radians. A surfel
# never mixes profiles of two times, as a view of more than a turn would.
_WIDTH, _MARGIN = math.radians(15.0), math.radians(8.0)
# Sections of one sweep that are closer in angle are adjacent: they are not compared.
_APART = math.radians(60.0)
# Two surfels can fit if the angle between their normals has at least this cosine (37 degrees), and
# if they are at most so many spacings apart along the surface.
_MIN_COSINE, _MAX_TANGENTIAL = 0.8, 1.2
# Surfels this close, meters, measure the same part of the surface, though it may have moved.
_SAME_PLACE = 6e-3
# A sweep repeats what it measured within this angle, radians, of a whole turn.
_TURN, _REPEAT = 2.0 * math.pi, math.radians(4.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class Section:
    """
    Consecutive profiles of one view.

    view : index of the view
    angle_from, angle_to : reported table angles, radians
    seq : mean number of its profiles, the order in time
    """

    view: int
    angle_from: float
    angle_to: float
    seq: float
    surfels: Surfels


@dataclass(frozen=True, eq=False, kw_only=True)
class RotationFit:
    """
    Fit of n surfels at d rotations about the axis.

    own : (n,) index of the surfel's section
    other : (n, d) section of the nearest surfel of another time; -1 if there is none nearby
    fit : (n, d) 1 for a distance of 0, down to 0 at the tolerance
    """

    own: Ints
    other: Ints
    fit: Floats


@dataclass(frozen=True, eq=False, kw_only=True)
class Sections:
    """
    All sections in the order of time.

    numbers, lasers : of each view
    steps : radians between the profiles of each view, see ``profile_step``
    spacing : meters, between surfels
    """

    items: Sequence[Section]
    numbers: Sequence[int]
    lasers: Sequence[int]
    steps: Sequence[float]
    spacing: float

    @cached_property
    def surfels(self) -> Surfels:
        """The surfels of all sections."""
        return concatenate_surfels([item.surfels for item in self.items])

    @cached_property
    def own(self) -> Ints:
        """(n,) section of each surfel."""
        return np.repeat(np.arange(len(self.items)), [len(item.surfels) for item in self.items])

    @cached_property
    def arms(self) -> Floats:
        """(n,) distance, meters, at which the normal of each surfel passes the axis."""
        (x, y, _), (nx, ny, _) = self.surfels.points_xyz.T, self.surfels.normals.T
        return np.asarray(np.abs(x * ny - y * nx))

    @property
    def largest_view(self) -> int:
        """Number of surfels of the view that has most."""
        views = np.array([item.view for item in self.items])[self.own]
        return int(np.bincount(views).max()) if len(views) else 0

    def placed(self, poses: Poses) -> 'Sections':
        """Return the sections with each view at its pose."""
        T = poses.turntable_from_view
        items = [
            replace(item, surfels=item.surfels.transformed(T[item.view])) for item in self.items
        ]
        return replace(self, items=items)

    def others(self, index: int) -> Bools:
        """Return (sections,) which ones are compared with this one."""
        here = self.items[index]
        return np.array(
            [item.view != here.view or _gap(item, here) >= _APART for item in self.items]
        )

    def of_other_lasers(self, index: int) -> Bools:
        """Return (sections,) which ones another laser than that of this one measured."""
        own = self.lasers[self.items[index].view]
        return np.array([self.lasers[item.view] != own for item in self.items])

    def repeated(self, view: int) -> Ints:
        """Return the sections of a view that lie a whole turn or more after its beginning."""
        own = [(k, item) for k, item in enumerate(self.items) if item.view == view]
        begin = min(item.angle_from for _, item in own)
        return np.array(
            [k for k, item in own if item.angle_from >= begin + _TURN - _REPEAT], dtype=np.int64
        )


def _gap(a: Section, b: Section) -> float:
    """Return the angle between two sections of a sweep, radians."""
    return max(a.angle_from - b.angle_to, b.angle_from - a.angle_to)


def profile_step(view: View) -> float:
    """
    Return mean or upper quartile of the steps between profiles, radians, the larger.

    Lost images count too: a good scan with a mean of 4.2 and a quartile of 4.9 degrees looked like
    a slip of -0.6.
    """
    if len(view.angles) < 2:
        return 0.0
    mean = float(np.ptp(view.angles)) / (len(view.angles) - 1)
    return max(mean, float(np.quantile(np.diff(np.sort(view.angles)), 0.75)))


def split_sections(views: Sequence[View]) -> Sections | None:
    """Return the sections of all views where the table had them; None if no view has a surface."""
    spacing = common_voxel_size(list(views), _MAX_SAMPLES)
    if not np.isfinite(spacing):
        return None
    items = [
        section
        for index, view in enumerate(views)
        if len(view.angles) > 1
        for section in _split(index, view, spacing)
    ]
    items.sort(key=lambda item: item.seq)
    return Sections(
        items=items,
        numbers=[view.number for view in views],
        lasers=[view.laser for view in views],
        steps=[profile_step(view) for view in views],
        spacing=spacing,
    )


def _split(index: int, view: View, spacing: float) -> list[Section]:
    first, last = float(view.angles[0]), float(view.angles[-1])
    # whole turns end at the edge of a section
    edges = np.append(np.arange(first, last - 0.2 * _WIDTH, _WIDTH), last + 1e-9)
    found = []
    for low, high in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        core = (view.angles >= low) & (view.angles < high)
        if core.any():
            surfels = _surfels(view, core, low, high, spacing)
            seq = float(np.mean(view.seqs[core]))
            found.append(
                Section(view=index, angle_from=low, angle_to=high, seq=seq, surfels=surfels)
            )
    return found


def _surfels(view: View, core: Bools, low: float, high: float, spacing: float) -> Surfels:
    """Return the surfels of the columns in ``core``, fitted to their neighbors too."""
    near = (view.angles >= low - _MARGIN) & (view.angles < high + _MARGIN)
    part = replace(
        view,
        **{name: getattr(view, name)[:, near] for name in ('points_xyz', 'intensity', 'sigma')},
        uv=view.uv[:, near],
        angles=view.angles[near],
        seqs=view.seqs[near],
        color=None,
    )
    samples = downsample(part, spacing)
    surfels = fit_surfels(samples, spacing)
    if not len(surfels):
        return surfels
    column = np.nonzero(part.valid)[1][samples.first[surfels.sample]]
    return surfels.select(core[near][column])


def compare_at(
    sections: Sections,
    rotations: Floats,
    tolerance: float,
    stride: int = 1,
    *,
    own: bool = False,
    lasers: bool = False,
) -> RotationFit:
    """
    Compare surfels, rotated about the axis, with the sections of other times.

    rotations : (d,) radians
    tolerance : meters, of the distance along the normal
    stride : use every stride-th surfel
    own : compare with all sections, its own ones too
    lasers : compare with those of other lasers only
    """
    surfels, spacing = sections.surfels, sections.spacing
    rows = np.arange(0, len(surfels), stride)
    owners = sections.own[rows]
    other = np.full((len(rows), len(rotations)), -1, dtype=np.int64)
    fit = np.zeros((len(rows), len(rotations)))
    # without a rotation, a surfel that has moved is found farther away
    reach = (
        _SAME_PLACE if len(rotations) == 1 else math.hypot(tolerance, _MAX_TANGENTIAL * spacing)
    )
    R = transforms.rotation_z(np.asarray(rotations))
    for index in range(len(sections.items)):
        mine = np.flatnonzero(owners == index)
        chosen = sections.of_other_lasers(index) if lasers else sections.others(index) | own
        targets = np.flatnonzero(chosen[sections.own])
        if not len(mine) or not len(targets):
            continue
        points = np.einsum('dij,nj->ndi', R, surfels.points_xyz[rows[mine]])
        normals = np.einsum('dij,nj->ndi', R, surfels.normals[rows[mine]])
        tree = cKDTree(surfels.points_xyz[targets])
        distance, near = tree.query(points, distance_upper_bound=reach)
        known = np.isfinite(distance)
        met = targets[near[known]]
        here, column = np.nonzero(known)
        other[mine[here], column] = sections.own[met]
        fit[mine[here], column] = _fit(
            surfels, met, points[known], normals[known], tolerance, spacing
        )
    return RotationFit(own=owners, other=other, fit=fit)


def _fit(
    surfels: Surfels,
    met: Ints,
    points: Floats,
    normals: Floats,
    tolerance: float,
    spacing: float,
) -> Floats:
    cosine = (normals * surfels.normals[met]).sum(axis=1)
    # the sense of a normal is arbitrary in each view
    both = normals + np.where(cosine < 0, -1.0, 1.0)[:, None] * surfels.normals[met]
    both /= np.linalg.norm(both, axis=1, keepdims=True)
    difference = points - surfels.points_xyz[met]
    residual = (difference * both).sum(axis=1)
    aside = np.sqrt(np.maximum((difference**2).sum(axis=1) - residual**2, 0.0))
    near = (np.abs(cosine) > _MIN_COSINE) & (aside < _MAX_TANGENTIAL * spacing)
    return np.where(near, np.maximum(1.0 - (residual / tolerance) ** 2, 0.0), 0.0)
