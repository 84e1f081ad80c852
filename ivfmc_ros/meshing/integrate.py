# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
All samples to one closed, oriented 2-manifold, of which then what was not seen can be taken off.

samples -> signed distance -> filled where nothing is -> surface -> noise taken out -> mesh
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.meshing.filters import components
from ivfmc_ros.meshing.filters import denoise
from ivfmc_ros.meshing.geometry import normals
from ivfmc_ros.meshing.geometry import topology
from ivfmc_ros.meshing.parallel import in_parts
from ivfmc_ros.meshing.samples.surface_samples import Samples
from ivfmc_ros.meshing.settings import MeshSettings
from ivfmc_ros.meshing.tsdf import closed_distance
from ivfmc_ros.meshing.tsdf import hole_filling
from ivfmc_ros.meshing.tsdf import signed_distance
from ivfmc_ros.meshing.tsdf import surface_nets
from ivfmc_ros.meshing.tsdf.blur import Spread
from ivfmc_ros.meshing.tsdf.space_carving import carve
from ivfmc_ros.model import BASE
from ivfmc_ros.model import Bools
from ivfmc_ros.model import BRIDGED
from ivfmc_ros.model import FILLED
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Kinds
from ivfmc_ros.model import MEASURED
from ivfmc_ros.model import Mesh
from ivfmc_ros.model import Singles

# One standard deviation of a normal, from that of a point: both ends of an edge of one voxel err.
_NORMAL_NOISE = 1.4
_LEAST_SAMPLES = 3
# Gaps of twice as many voxels stay closed. Wider bridges lie over grooves as well as over holes.
_BRIDGED_RINGS = 1
# A wall that ends so many rings above the platter stands on it.
_FOOT_RINGS = 6
_FACING_DOWN = -0.5  # cosine
# Mean of the kernel over a plane of samples, weighted by itself: one over how many voxels' worth
# of samples are averaged.
_MEAN_KERNEL = 1.0 / (
    np.sqrt(2.0 * np.pi) * signed_distance.SPREAD * 4.0 * np.pi * signed_distance.SPREAD**2
)
# Diagonals whose halves are bent alike within this (cosine) are chosen by their length.
_ALIKE = 0.01
_AT_ONCE = 1 << 14  # quads
_LAST_KIND = {'none': BRIDGED, 'base': BASE, 'all': FILLED}


@dataclass(frozen=True, eq=False, kw_only=True)
class _Shell:
    """
    What is known of a closed surface of quadrilaterals.

    sigma : (n,) metres, intensity : (n,) grey values, NaN at vertices that were not seen
    kind : (m,) of each quadrilateral
    """

    sigma: Floats
    intensity: Floats
    kind: Kinds


def integrate(samples: Samples, voxel: float, settings: MeshSettings) -> Mesh:
    """
    Return one surface of all samples.

    voxel : metres; gaps of up to 2 voxels are bridged, whatever ``close`` says
    :raises GeometryError: there are no samples, or what they make is smaller than ``island``
    """
    if len(samples) < _LEAST_SAMPLES:
        raise GeometryError(
            f'meshing: {len(samples)} points have neighbours on the surface, which make none; '
            'raise max_edge or scan in finer steps'
        )
    grid = signed_distance.grid_of(samples, voxel, settings.floor)
    sums = signed_distance.sum_up(grid, samples)
    blocks = sums.blocks
    with ThreadPoolExecutor(1) as beside:
        filling = beside.submit(_fill, sums, samples, settings.floor)
        measured, weight = signed_distance.distance(sums)
        carve(blocks, measured, samples)
    coarse = filling.result()
    net = surface_nets.extract(
        *closed_distance.whole_distance(blocks, measured, coarse, settings.floor)
    )
    shell = _shell(sums, weight, net, settings.floor)
    noise = np.nan_to_num(shell.sigma)[net.quads].max(axis=1) * (_NORMAL_NOISE / voxel)
    vertices = denoise.denoised(net.vertices, net.quads, noise, settings.smoothing)
    return _mesh(grid.points(vertices), net.quads, shell, voxel, settings)


def _fill(
    sums: signed_distance.Sums, samples: Samples, floor: float | None
) -> hole_filling.Coarse:
    empty = hole_filling.looked_through(sums.blocks.grid, samples)
    return hole_filling.fill(sums.blocks, sums, empty, floor)


def _shell(
    sums: signed_distance.Sums, weight: Singles, net: surface_nets.Nets, floor: float | None
) -> _Shell:
    blocks = sums.blocks
    place = blocks.place(net.cells)
    counts, light = sums.spread.around(sums.seen, place).T
    seen = told = counts > 0.5
    if len(sums.alone):
        ones = np.ones((len(sums.alone), 1), dtype=np.float32)
        told = seen | (Spread(blocks, sums.alone).around(ones, place)[:, 0] > 0.5)
    level = None if floor is None else (floor - blocks.grid.origin[2]) / blocks.grid.voxel
    weight = weight.reshape(-1).take(np.maximum(place, 0))
    with np.errstate(invalid='ignore', divide='ignore'):
        sigma = np.sqrt(_MEAN_KERNEL / (weight * sums.scale))
        intensity = light / counts
    return _Shell(
        sigma=np.where(seen, sigma, np.nan).astype(np.float64),
        intensity=np.where(seen, intensity, np.nan).astype(np.float64),
        kind=_kinds(net, seen, told, level),
    )


def _kinds(net: surface_nets.Nets, seen: Bools, told: Bools, level: float | None) -> Kinds:
    """
    Tell what was measured, what lies below all that was, and what fills a hole.

    told : of each vertex, a point is near, with a normal (``seen``) or alone
    """
    measured = seen[net.quads].all(axis=1)
    kind = np.where(measured, MEASURED, FILLED).astype(np.uint8)
    covered = told | ~_grown(net, ~_grown(net, told, _BRIDGED_RINGS), _BRIDGED_RINGS)
    kind[covered[net.quads].all(axis=1) & ~measured] = BRIDGED
    if level is not None:
        kind[_foot(net, seen, level) & ~measured] = BASE
    if measured.any():
        lowest = net.vertices[net.quads[measured], 2].min()
        low = (net.vertices[:, 2] < lowest + 1.0)[net.quads].all(axis=1)
        kind[low & (kind == FILLED)] = BASE
    return kind


def _foot(net: surface_nets.Nets, seen: Bools, level: float) -> Bools:
    """Tell which quads go on with a wall that was seen to just above the platter, down to it."""
    on_platter = ~seen & (np.abs(net.vertices[:, 2] - level) < 1.0)
    below, above = [seen], [on_platter]
    for _ in range(_FOOT_RINGS):
        below.append(_grown(net, below[-1], 1))
        above.append(_grown(net, above[-1], 1))
    # on the way from what was seen to the platter, if that is short enough
    between = np.any([a & b for a, b in zip(below, reversed(above), strict=True)], axis=0)
    upright = denoise.quad_normals(net.vertices, net.quads)[:, 2] > _FACING_DOWN
    return np.asarray(upright & between[net.quads].all(axis=1))


def _grown(net: surface_nets.Nets, chosen: Bools, rings: int) -> Bools:
    """Add ``rings`` rings of neighbours to a choice of vertices."""
    for _ in range(rings):
        touched = chosen[net.quads].any(axis=1)
        chosen = chosen.copy()
        chosen[net.quads[touched].ravel()] = True
    return chosen


def _mesh(
    vertices_xyz: Floats, quads: Ints, shell: _Shell, voxel: float, settings: MeshSettings
) -> Mesh:
    keep, flying = _wanted(vertices_xyz, quads, shell.kind, voxel, settings)
    if not len(keep):
        raise GeometryError(
            f'meshing: no piece of surface has {settings.island} triangles; lower island'
        )
    used, quads = topology.compact(quads[keep], len(vertices_xyz))
    vertices_xyz = vertices_xyz[used]
    faces = _halves(vertices_xyz, quads)
    return Mesh(
        vertices_xyz=vertices_xyz,
        faces=faces,
        normals=normals.of_vertices(vertices_xyz, faces),
        sigma=shell.sigma[used],
        intensity=shell.intensity[used],
        kind=np.concatenate([shell.kind[keep]] * 2),
        flying=flying,
    )


def _wanted(
    vertices_xyz: Floats, quads: Ints, kind: Kinds, voxel: float, settings: MeshSettings
) -> tuple[Ints, int]:
    """Return which quadrilaterals become part of the mesh, and how many pieces of them fly."""
    count = len(vertices_xyz)
    chosen = np.flatnonzero(kind <= _LAST_KIND[settings.close])
    piece = topology.pieces(quads[chosen], count)
    for _ in range(2):
        solid = components.solid(piece, kind[chosen], settings.island // 2)
        chosen, piece = chosen[solid], piece[solid]
        if settings.close == 'all':
            break
        untied = topology.without_bow_ties(quads[chosen], count)
        if untied.all():
            break
        chosen = chosen[untied]
        piece = topology.pieces(quads[chosen], count)
    gone, flying = components.flying(vertices_xyz, quads[chosen], piece, voxel)
    return chosen[~gone], flying


def _halves(vertices_xyz: Floats, quads: Ints) -> Ints:
    """Cut each quadrilateral along the diagonal across which it is less bent."""
    single, count = vertices_xyz.astype(np.float32), len(quads)
    faces = np.empty((2 * count, 3), dtype=np.int64)

    def cut(some: slice) -> None:
        corner = quads[some]
        along_ac = _cut_along_ac(single.take(corner.T, axis=0))[:, None]
        faces[some] = np.where(along_ac, corner[:, [0, 1, 2]], corner[:, [0, 1, 3]])
        second = slice(count + some.start, count + some.stop)
        faces[second] = np.where(along_ac, corner[:, [0, 2, 3]], corner[:, [1, 2, 3]])

    in_parts(cut, count, _AT_ONCE)
    return faces


def _cut_along_ac(corners_xyz: Singles) -> Bools:
    a, b, c, d = np.ascontiguousarray(np.moveaxis(corners_xyz, 2, 1))
    bent = []
    for first, second in (((a, b, c), (a, c, d)), ((a, b, d), (b, c, d))):
        one, two = (normals.cross(q - p, r - p) for p, q, r in (first, second))
        lengths = np.sqrt((one * one).sum(axis=0)) * np.sqrt((two * two).sum(axis=0))
        bent.append((one * two).sum(axis=0) / np.maximum(lengths, 1e-30))
    alike = np.abs(bent[0] - bent[1]) < _ALIKE
    shorter = ((c - a) ** 2).sum(axis=0) <= ((d - b) ** 2).sum(axis=0)
    return np.asarray(np.where(alike, shorter, bent[0] > bent[1]))
