# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Volumetric integration: surface samples to one oriented 2-manifold mesh.

Steps: signed distance on voxels, hole filling and space carving, surface nets, bilateral
denoising, classification of the faces as measured or not, selection of the faces to keep.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.meshing.filters import components
from ivfmc_ros.meshing.filters import denoise
from ivfmc_ros.meshing.geometry import normals
from ivfmc_ros.meshing.geometry import topology
from ivfmc_ros.meshing.parallel import run_chunked
from ivfmc_ros.meshing.samples.surface_samples import SurfaceSamples
from ivfmc_ros.meshing.settings import MeshSettings
from ivfmc_ros.meshing.tsdf import closed_distance
from ivfmc_ros.meshing.tsdf import hole_filling
from ivfmc_ros.meshing.tsdf import signed_distance
from ivfmc_ros.meshing.tsdf import surface_nets
from ivfmc_ros.meshing.tsdf.blur import SparseBlur
from ivfmc_ros.meshing.tsdf.space_carving import carve_free_space
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

# 1 sigma of the normal of a quad (radians) for 1 sigma of its vertices in voxels: both ends of an
# edge of one voxel err, which gives sqrt 2.
_NORMAL_NOISE = 1.4
_MIN_SAMPLES = 3
# Radius in rings of quads by which gaps are closed, so that gaps of up to 2 voxels are bridged.
# With a larger radius grooves and holes of the part are bridged too.
_BRIDGE_RINGS = 1
# A wall that was measured to within so many rings above the platter is continued down to it.
_WALL_RINGS = 6
_FACING_DOWN = -0.5  # cosine of a normal to z, below which a quad is no wall
# Integral of the squared kernel, the kernel normalized to 1, over a plane of samples: the inverse
# of the number of voxels whose samples are averaged.
_MEAN_KERNEL = 1.0 / (
    np.sqrt(2.0 * np.pi)
    * signed_distance.KERNEL_SIGMA
    * 4.0
    * np.pi
    * signed_distance.KERNEL_SIGMA**2
)
# If the cosines of the bends along both diagonals of a quad differ by less, the shorter is used.
_SAME_BEND = 0.01
_CHUNK = 1 << 14  # quads
_LAST_KIND = {'none': BRIDGED, 'base': BASE, 'all': FILLED}


@dataclass(frozen=True, eq=False, kw_only=True)
class _Attributes:
    """
    Attributes of a closed surface of quads.

    sigma : (n,) meters, of the vertices; NaN where not measured
    systematic : (n,) meters, of the error that neighboring vertices share, likewise
    intensity : (n,) gray values, likewise
    kind : (m,) uint8, of the quads
    """

    sigma: Floats
    systematic: Floats
    intensity: Floats
    kind: Kinds


def integrate(samples: SurfaceSamples, voxel: float, settings: MeshSettings) -> Mesh:
    """
    Return one surface of all samples.

    voxel : meters; gaps of up to 2 voxels are bridged, whatever ``close`` is
    :raises GeometryError: there are no samples, or their surface is smaller than ``island``
    :raises ParameterError: the voxel is too small for the part
    """
    if len(samples) < _MIN_SAMPLES:
        raise GeometryError(
            f'meshing: only {len(samples)} points have neighbors on the surface; '
            'raise max_edge or scan in finer steps'
        )
    grid = signed_distance.enclosing_grid(samples, voxel, settings.floor)
    sums = signed_distance.accumulate(grid, samples)
    blocks = sums.blocks
    with ThreadPoolExecutor(1) as executor:
        filling = executor.submit(_fill_holes, sums, samples, settings.floor)
        measured, weight = signed_distance.signed_distance(sums)
        carve_free_space(blocks, measured, samples)
    coarse = filling.result()
    surface = surface_nets.extract_surface(
        *closed_distance.close_distance(blocks, measured, coarse, settings.floor)
    )
    attributes = _attributes(sums, weight, surface, settings.floor)
    quad_sigma = np.nan_to_num(attributes.sigma)[surface.quads].max(axis=1)
    noise = quad_sigma * (_NORMAL_NOISE / voxel)
    vertices = denoise.denoise_quads(surface.vertices, surface.quads, noise, settings.smoothing)
    return _to_mesh(grid.to_points(vertices), surface.quads, attributes, voxel, settings)


def _fill_holes(
    sums: signed_distance.SampleSums, samples: SurfaceSamples, floor: float | None
) -> hole_filling.CoarseDistance:
    empty = hole_filling.observed_free_space(sums.blocks.grid, samples)
    return hole_filling.fill_holes(sums.blocks, sums, empty, floor)


def _attributes(
    sums: signed_distance.SampleSums,
    weight: Singles,
    surface: surface_nets.QuadSurface,
    floor: float | None,
) -> _Attributes:
    """Return what is known of the vertices and quads of the closed surface."""
    blocks = sums.blocks
    indices = blocks.flat_indices(surface.cells)
    counts, light, weights, systematic = sums.blur.sum_neighborhoods(sums.counts, indices).T
    seen = touched = counts > 0.5
    if len(sums.orphans):
        ones = np.ones((len(sums.orphans), 1), dtype=np.float32)
        orphan_blur = SparseBlur(blocks, sums.orphans)
        touched = seen | (orphan_blur.sum_neighborhoods(ones, indices)[:, 0] > 0.5)
    level = None if floor is None else (floor - blocks.grid.origin[2]) / blocks.grid.voxel
    weight = weight.reshape(-1).take(np.maximum(indices, 0))
    with np.errstate(invalid='ignore', divide='ignore'):
        sigma = np.sqrt(_MEAN_KERNEL / (weight * sums.mean_weight))
        intensity = light / counts
        # errors that the samples share do not average out: a linear mean
        systematic = systematic / weights if sums.systematic_known else np.nan * weights
    return _Attributes(
        sigma=np.where(seen, sigma, np.nan).astype(np.float64),
        systematic=np.where(seen, systematic, np.nan).astype(np.float64),
        intensity=np.where(seen, intensity, np.nan).astype(np.float64),
        kind=_classify_quads(surface, seen, touched, level),
    )


def _classify_quads(
    surface: surface_nets.QuadSurface, seen: Bools, touched: Bools, level: float | None
) -> Kinds:
    """
    Return the kind of each quad: MEASURED, BRIDGED, BASE or FILLED.

    seen : (n,) bool, a sample is near the vertex
    touched : (n,) bool, a sample or an orphan point is near the vertex
    level : height of the platter, voxels; None for none
    """
    measured = seen[surface.quads].all(axis=1)
    kind = np.where(measured, MEASURED, FILLED).astype(np.uint8)
    # morphological closing of the touched vertices
    closed = ~_dilated(
        surface.quads, ~_dilated(surface.quads, touched, _BRIDGE_RINGS), _BRIDGE_RINGS
    )
    covered = touched | closed
    kind[covered[surface.quads].all(axis=1) & ~measured] = BRIDGED
    if level is not None:
        kind[_wall_above_platter(surface, seen, level) & ~measured] = BASE
    if measured.any():
        lowest = surface.vertices[surface.quads[measured], 2].min()
        low = (surface.vertices[:, 2] < lowest + 1.0)[surface.quads].all(axis=1)
        kind[low & (kind == FILLED)] = BASE
    return kind


def _wall_above_platter(surface: surface_nets.QuadSurface, seen: Bools, level: float) -> Bools:
    """Return which quads continue a wall, measured to just above the platter, down to it."""
    height = np.abs(surface.vertices[:, 2] - level)
    # a ring is at most two voxels wide: nothing else is that many rings from the platter
    low = np.flatnonzero((height < 1.0 + 2.0 * _WALL_RINGS).take(surface.quads[:, 0]))
    near = surface.quads[low]
    on_platter = ~seen & (height < 1.0)
    below, above = [seen], [on_platter]
    for _ in range(_WALL_RINGS):
        below.append(_dilated(near, below[-1], 1))
        above.append(_dilated(near, above[-1], 1))
    # on a path of at most that many rings from the measured vertices to the platter
    between = np.any([a & b for a, b in zip(below, reversed(above), strict=True)], axis=0)
    upright = denoise.quad_normals(surface.vertices, near)[:, 2] > _FACING_DOWN
    wall = np.zeros(len(surface.quads), dtype=bool)
    wall[low] = upright & between[near].all(axis=1)
    return wall


def _dilated(quads: Ints, chosen: Bools, rings: int) -> Bools:
    """Add ``rings`` rings of neighbors, by the quads, to a choice of vertices."""
    for _ in range(rings):
        corners = chosen.take(quads)
        # a third of the time of any(axis=1)
        reached = corners[:, 0] | corners[:, 1] | corners[:, 2] | corners[:, 3]
        chosen = chosen.copy()
        chosen[quads[reached].ravel()] = True
    return chosen


def _to_mesh(
    vertices_xyz: Floats,
    quads: Ints,
    attributes: _Attributes,
    voxel: float,
    settings: MeshSettings,
) -> Mesh:
    """
    Return the triangle mesh of the quads that the settings keep.

    :raises GeometryError: no connected component is large enough
    """
    keep, isolated = _select_quads(vertices_xyz, quads, attributes.kind, voxel, settings)
    if not len(keep):
        raise GeometryError(
            f'meshing: no connected component has {settings.island} triangles; lower island'
        )
    used, quads = topology.compact_vertices(quads[keep], len(vertices_xyz))
    vertices_xyz = vertices_xyz[used]
    faces = _split_quads(vertices_xyz, quads)
    return Mesh(
        vertices_xyz=vertices_xyz,
        faces=faces,
        normals=normals.vertex_normals(vertices_xyz, faces),
        sigma=attributes.sigma[used],
        systematic=attributes.systematic[used],
        intensity=attributes.intensity[used],
        kind=np.concatenate([attributes.kind[keep]] * 2),
        isolated_components=isolated,
    )


def _select_quads(
    vertices_xyz: Floats, quads: Ints, kind: Kinds, voxel: float, settings: MeshSettings
) -> tuple[Ints, int]:
    """Return the indices of the quads to keep, and the number of isolated components dropped."""
    count = len(vertices_xyz)
    chosen = np.flatnonzero(kind <= _LAST_KIND[settings.close])
    component = topology.face_components(quads[chosen], count)
    for _ in range(2):
        # two triangles per quad
        keep = components.select_components(component, kind[chosen], settings.island // 2)
        chosen, component = chosen[keep], component[keep]
        if settings.close == 'all':
            break
        manifold = topology.faces_without_bow_ties(quads[chosen], count)
        if manifold.all():
            break
        chosen = chosen[manifold]
        component = topology.face_components(quads[chosen], count)
    isolated, number = components.find_isolated_components(
        vertices_xyz, quads[chosen], component, voxel
    )
    return chosen[~isolated], number


def _split_quads(vertices_xyz: Floats, quads: Ints) -> Ints:
    """Split each quad into two triangles along the diagonal with the smaller bend."""
    single, count = vertices_xyz.astype(np.float32), len(quads)
    faces = np.empty((2 * count, 3), dtype=np.int64)

    def split(chunk: slice) -> None:
        corner = quads[chunk]
        along_ac = _split_along_ac(single.take(corner.T, axis=0))[:, None]
        faces[chunk] = np.where(along_ac, corner[:, [0, 1, 2]], corner[:, [0, 1, 3]])
        second = slice(count + chunk.start, count + chunk.stop)
        faces[second] = np.where(along_ac, corner[:, [0, 2, 3]], corner[:, [1, 2, 3]])

    run_chunked(split, count, _CHUNK)
    return faces


def _split_along_ac(corners_xyz: Singles) -> Bools:
    """Return (m,) bool for (4, m, 3) corners a, b, c, d of quads."""
    a, b, c, d = np.ascontiguousarray(np.moveaxis(corners_xyz, 2, 1))
    cosines = []
    for first, second in (((a, b, c), (a, c, d)), ((a, b, d), (b, c, d))):
        one, two = (normals.cross(q - p, r - p) for p, q, r in (first, second))
        lengths = np.sqrt((one * one).sum(axis=0)) * np.sqrt((two * two).sum(axis=0))
        cosines.append((one * two).sum(axis=0) / np.maximum(lengths, 1e-30))
    same = np.abs(cosines[0] - cosines[1]) < _SAME_BEND
    shorter = ((c - a) ** 2).sum(axis=0) <= ((d - b) ** 2).sum(axis=0)
    return np.asarray(np.where(same, shorter, cosines[0] > cosines[1]))
