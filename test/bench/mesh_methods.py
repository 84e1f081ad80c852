# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bench of meshing: three methods against CAD, closed meshes, time, and the Stanford bunny."""

from collections.abc import Callable
from collections.abc import Iterator
from dataclasses import dataclass
import math
from pathlib import Path
import tempfile
import time

import numpy as np
import open3d as o3d
from support.cylinder_scan import coverage
from support.real_scan import data_folder
from support.stanford_bunny import read_bunny
import trimesh

from bench import at_least
from bench import at_most
from bench import Number
from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.meshing.build import build_mesh
from ivfmc_ros.meshing.integrate import integrate
from ivfmc_ros.meshing.io import export
from ivfmc_ros.meshing.io.export import UNITS
from ivfmc_ros.meshing.poisson import poisson
from ivfmc_ros.meshing.samples.range_grid import median_spacings
from ivfmc_ros.meshing.samples.surface_samples import merge_samples
from ivfmc_ros.meshing.samples.surface_samples import sample_grid
from ivfmc_ros.meshing.samples.surface_samples import SurfaceSamples
from ivfmc_ros.meshing.settings import MeshSettings
from ivfmc_ros.model import BASE
from ivfmc_ros.model import BRIDGED
from ivfmc_ros.model import FILLED
from ivfmc_ros.model import Floats
from ivfmc_ros.model import MEASURED
from ivfmc_ros.model import Mesh
from ivfmc_ros.pipeline import reconstruct
from ivfmc_ros.pipeline import Reconstruction
from ivfmc_ros.pipeline import Settings
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.loading import Solid
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.simulation.parts.solids import demo_part
from ivfmc_ros.simulation.parts.solids import stepped_shaft
from ivfmc_ros.simulation.render.optics import Optics
from ivfmc_ros.simulation.render.optics import with_sheet_thickness
from ivfmc_ros.simulation.render.renderer import simulate_scan
from ivfmc_ros.stripe.acquisition import AcquisitionSettings
from ivfmc_ros.surface import Surface

STEPS = 200
CELL = with_sheet_thickness(bench_cell(), Optics())
PARTS = {
    'demo part': demo_part,
    'cube': lambda: box((0.04, 0.04, 0.04)),
    'stepped shaft': lambda: stepped_shaft([(0.03, 0.02), (0.02, 0.02), (0.012, 0.02)]),
}
# STL files state no unit; featuretype and plate_holes are larger than the working volume.
UNITS_OF_CAD = {
    'angle_block.STL': 'inch',
    'featuretype.STL': 'inch',
    'idler_riser.STL': 'inch',
    'octagonal_pocket.stl': 'm',
    'plate_holes.STL': 'mm',
}
VOLUME = Volume(bottom=0.5e-3)
# The stripe of the bench cell is 2.5 px (1 sigma) wide: 4 sigma at 0.17 mm a pixel.
STRIPE_WIDTH = 1.7e-3
# Points nearer than this to an edge of the CAD are not on a face.
FACE_MARGIN = 1.2e-3
CERTAIN = 0.05e-3  # meters, 1 sigma of the stripe bias that a vertex states
FIGURES = {
    'mesh to CAD, rms': 'rms',
    'mesh to CAD, 95 %': 'p95',
    'CAD to mesh, rms': 'back_rms',
    'CAD to mesh, 95 %': 'back_p95',
}


def run() -> Iterator[Number]:
    for name, part in [*((name, make()) for name, make in PARTS.items()), *cad_parts()]:
        made = scan(part)
        yield from methods(name, part, made)
        if name != 'demo part':
            yield from closed(name, part, made)
    covered, width = coverage(cells=100, seed=11)
    note = f'bench cell, R 20 mm, median width of the interval {width * 1e3:.3f} mm'
    yield Number('diameters within their 95 % interval', covered, 'of 100', at_least(90), note)
    yield from times()
    yield from bunny()


def cad_parts() -> Iterator[tuple[str, Solid]]:
    """Yield the CAD of machined parts that fit the working volume, centered on the platter."""
    folder = data_folder() / 'parts'
    for name, unit in UNITS_OF_CAD.items():
        if not (folder / name).is_file():
            continue
        mesh = trimesh.load(folder / name)
        # corners of one vertex may differ by rounding
        mesh.merge_vertices(digits_vertex=5)
        low, high = mesh.bounds
        middle = np.array([*(low + high)[:2] / 2, low[2]])
        vertices = (np.asarray(mesh.vertices) - middle) / UNITS[unit]
        across = np.linalg.norm(vertices[:, :2], axis=1).max()
        if across < Volume().radius and vertices[:, 2].max() < Volume().top:
            faces = np.asarray(mesh.faces, dtype=np.int64)
            yield Path(name).stem, Solid(vertices_xyz=vertices, faces=faces)


def scan(part: Solid, seed: int = 1) -> Reconstruction:
    settings = Settings(acquisition=AcquisitionSettings(volume=VOLUME))
    return reconstruct(CELL, simulate_scan(CELL, part, STEPS, seed=seed), settings)


@dataclass(frozen=True)
class Quality:
    rms: float
    p95: float
    back_rms: float
    back_p95: float
    faces_rms: float
    certain_rms: float
    measured_rms: float


def methods(name: str, part: Solid, made: Reconstruction) -> Iterator[Number]:
    """Distances of mesh to CAD and CAD to mesh: 200 steps, both lasers, speckle 0.15."""
    truth = Surface(part.vertices_xyz, part.faces)
    points = np.concatenate([view.cloud() for view in made.views])
    distance = truth.signed_distance(points)
    raw_faces = rms(distance[on_faces(truth, points)])
    seen = seen_of_cad(part, points)
    found = {}
    for method in ('paper', 'integrate', 'poisson'):
        mesh = build_mesh(CELL, made.views, made.poses, MeshSettings(method=method))
        found[method] = quality(mesh, truth, seen)
    best = found['integrate']
    yield from compared(name, found)
    note = f'raw points {raw_faces * 1e3:.4f} mm, mesh {best.faces_rms * 1e3:.4f} mm'
    note += f'; vertices that state a stripe bias below 0.05 mm: {best.certain_rms * 1e3:.4f} mm'
    yield Number(
        f'{name}, faces, share of the raw rms', best.faces_rms / raw_faces, '', at_most(0.35), note
    )


def compared(name: str, found: dict[str, Quality]) -> Iterator[Number]:
    """Rms and 95 % of each method in both directions; integrate has to be the best."""
    for method, own in found.items():
        others = [quality for key, quality in found.items() if key != method]
        for figure, field in FIGURES.items():
            value = 1e3 * getattr(own, field)
            best = 1e3 * min(getattr(other, field) for other in others)
            bar = at_most(best) if method == 'integrate' else None
            note = f'of measured faces {own.measured_rms * 1e3:.4f} mm' if field == 'rms' else ''
            yield Number(f'{name}, {method}, {figure}', value, 'mm', bar, note)


def rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def quality(mesh: Mesh, truth: Surface, seen: Floats) -> Quality:
    distance = truth.signed_distance(mesh.vertices_xyz)
    faces = on_faces(truth, mesh.vertices_xyz)
    certain = np.ones(len(faces), dtype=bool)
    if mesh.systematic is not None:
        certain = mesh.systematic < CERTAIN
    back = Surface(mesh.vertices_xyz, mesh.faces).nearest(seen).distance
    return Quality(
        rms=rms(distance),
        p95=float(np.percentile(np.abs(distance), 95)),
        back_rms=rms(back),
        back_p95=float(np.percentile(back, 95)),
        faces_rms=rms(distance[faces]),
        certain_rms=rms(distance[faces & certain]),
        measured_rms=rms(distance[measured(mesh)]),
    )


def measured(mesh: Mesh) -> np.ndarray:
    """Return the indices of vertices of measured faces."""
    faces = mesh.faces if mesh.kind is None else mesh.faces[mesh.kind == MEASURED]
    return np.unique(faces)


def on_faces(truth: Surface, points: Floats) -> np.ndarray:
    """Return (n,) bool, which points are farther than FACE_MARGIN from edges of the CAD."""
    near = truth.nearest(points)
    n = near.normals
    ok = near.distance < 0.3e-3
    first = np.cross(n, [0.3, 0.5, 0.8])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(n, first)
    for angle in np.linspace(0, 2 * np.pi, 8, endpoint=False):
        step = np.cos(angle) * first + np.sin(angle) * second
        there = truth.nearest(near.points_xyz + FACE_MARGIN * step)
        ok &= ((there.normals * n).sum(axis=1) > 0.99) & (there.distance < 0.06e-3)
    return ok


def seen_of_cad(part: Solid, points: Floats) -> Floats:
    """Return points of the CAD in the working volume that have a measured point within 0.5 mm."""
    cad = trimesh.Trimesh(part.vertices_xyz, part.faces, process=False)
    wanted, _ = trimesh.sample.sample_surface(cad, 60_000, seed=2)
    # nothing nearer to the platter is measured, whatever the method
    wanted = wanted[wanted[:, 2] > VOLUME.bottom]
    tree = o3d.geometry.KDTreeFlann(points.T)
    near = [tree.search_knn_vector_3d(point, 1)[2][0] for point in wanted]
    return np.asarray(wanted)[np.sqrt(near) < 0.5e-3]


def closed(name: str, part: Solid, made: Reconstruction) -> Iterator[Number]:
    """The mesh with ``close: all``: sound, of the right volume, with sharp edges."""
    mesh = build_mesh(CELL, made.views, made.poses, MeshSettings(close='all'))
    read = trimesh.Trimesh(mesh.vertices_xyz * 1e3, mesh.faces, process=False)
    sound = read.is_watertight and read.is_winding_consistent and read.area_faces.min() > 0
    yield Number(f'{name}, watertight and oriented', float(sound), '', at_least(1))
    crossed = intersecting(mesh)
    note = f'{len(mesh.faces)} faces, blockwise by open3d'
    yield Number(f'{name}, faces that intersect', crossed, '', at_most(0), note)
    off = abs(read.volume * 1e-9 / part.volume - 1.0)
    yield Number(f'{name}, volume', off * 100, '%', at_most(0.1), volume_by_kind(mesh, part))
    spacing = max(median_spacings(made.views[0].points_xyz))
    bar = at_most(max(1.5 * spacing, STRIPE_WIDTH) * 1e3)
    note = f'spacing {spacing * 1e3:.2f} mm, stripe {STRIPE_WIDTH * 1e3:.1f} mm wide'
    yield Number(f'{name}, edge radius, median', edge_radius(mesh, part) * 1e3, 'mm', bar, note)


def volume_by_kind(mesh: Mesh, part: Solid) -> str:
    """Return how much of the volume lies between the CAD and the faces of each kind."""
    corners = mesh.vertices_xyz[mesh.faces]
    sides = corners[:, 1:] - corners[:, :1]
    area = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    truth = Surface(part.vertices_xyz, part.faces)
    between = area * truth.signed_distance(corners.mean(axis=1)) / part.volume
    kinds = np.zeros(len(area)) if mesh.kind is None else mesh.kind
    names = {'measured': MEASURED, 'bridged': BRIDGED, 'base': BASE, 'filled': FILLED}
    parts = (f'{key} {100 * between[kinds == kind].sum():+.3f} %' for key, kind in names.items())
    return f'between CAD and faces: {", ".join(parts)}'


def edge_radius(mesh: Mesh, part: Solid) -> float:
    """
    Return the radius of the rounding of square edges, meters, from the median gap at the edges.

    A rounding of radius r leaves a gap of r (sqrt 2 - 1) between the edge and the surface.
    """
    cad = trimesh.Trimesh(part.vertices_xyz, part.faces, process=True)
    sharp = np.asarray(cad.face_adjacency_angles) > 1.2
    convex = np.asarray(cad.face_adjacency_convex)
    ends = cad.vertices[np.asarray(cad.face_adjacency_edges)[sharp & convex]]
    share = np.linspace(0.1, 0.9, 20)[:, None, None]
    edges = (ends[None, :, 0] * (1 - share) + ends[None, :, 1] * share).reshape(-1, 3)
    # edges at the platter are not measured
    edges = edges[edges[:, 2] > 2e-3]
    gap = Surface(mesh.vertices_xyz, mesh.faces).nearest(edges).distance
    return float(np.median(gap)) / (np.sqrt(2.0) - 1.0)


def intersecting(mesh: Mesh, side: float = 4e-3) -> int:
    """Return the number of pairs of intersecting faces, by Open3D on overlapping blocks."""
    corners = mesh.vertices_xyz[mesh.faces]
    middle = corners.mean(axis=1)
    block = np.floor(middle / side).astype(np.int64)
    pairs = 0
    for cell in np.unique(block, axis=0):
        low, high = cell * side, (cell + 1) * side
        near = ((middle > low - 1e-3) & (middle < high + 1e-3)).all(axis=1)
        used, faces = np.unique(mesh.faces[near], return_inverse=True)
        part = o3d.geometry.TriangleMesh(
            o3d.utility.Vector3dVector(mesh.vertices_xyz[used]),
            o3d.utility.Vector3iVector(faces.reshape(-1, 3)),
        )
        pairs += len(part.get_self_intersecting_triangles())
    return pairs


def bumpy_ball(count: int) -> SurfaceSamples:
    """Return noisy samples of a bumpy sphere of 30 mm radius."""
    rng = np.random.default_rng(0)
    normal = rng.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    bump = 0.03 * (1 + 0.02 * np.sin(9 * normal[:, :1]) * np.cos(7 * normal[:, 1:2]))
    return SurfaceSamples(
        points_xyz=bump * normal + rng.normal(scale=1e-5, size=(count, 3)),
        normals=normal,
        to_camera=normal,
        weight=np.full(count, 1e10),
        intensity=np.full(count, 100.0),
        systematic=np.zeros(count),
    )


@dataclass(frozen=True)
class Took:
    """Wall time and processor time, seconds."""

    wall: float
    processor: float

    def __str__(self) -> str:
        return f'{self.wall:.1f} s (processor {self.processor:.1f} s)'


def times() -> Iterator[Number]:
    """Time from one million points to a closed mesh file; run it alone on the machine."""
    settings = MeshSettings(close='all', floor=None)
    count = 1_000_000
    points = bumpy_ball(count)
    # as many vertices as points: about 1.5 per face of a voxel
    voxel = float(np.sqrt(1.6 * 4 * np.pi * 0.03**2 / count))
    ours, vertices = timed(lambda: integrate(points, voxel, settings))
    theirs, others = timed(lambda: poisson(points, voxel, 1.0, settings))
    # scaled to an equal number of vertices
    fair = vertices / others
    note = f'{ours}, {vertices} vertices; Poisson {theirs}, {others} vertices; processor time '
    note += f'{ours.processor / (theirs.processor * fair):.3f}'
    share = ours.wall / (theirs.wall * fair)
    yield Number('a million points, share of Poisson', share, '', at_most(0.2), note)


def timed(make: Callable[[], Mesh]) -> tuple[Took, int]:
    """Return the time to make and write a mesh, and its number of vertices."""
    wall, processor = time.perf_counter(), time.process_time()
    mesh = make()
    with tempfile.TemporaryDirectory() as folder:
        export.write_mesh(Path(folder) / 'mesh.stl', mesh)
    took = Took(time.perf_counter() - wall, time.process_time() - processor)
    return took, len(mesh.vertices_xyz)


def bunny() -> Iterator[Number]:
    """The ten range scans of the Stanford bunny with their published poses."""
    folder = data_folder() / 'bunny'
    if not folder.is_dir():
        # a row that is missing fails, and the others are measured
        note = f'not measured: {folder} is missing; IVFMC_DATA names the folder of the data'
        yield Number('bunny, median distance', math.nan, 'mm', at_most(0.2), note)
        return
    grids = read_bunny(folder)
    steps = np.median([median_spacings(grid.points_xyz) for grid in grids], axis=0)
    voxel = float(np.sqrt(np.prod(steps)))
    points = merge_samples(sample_grid(grid, None, voxel) for grid in grids)
    mesh = integrate(points, voxel, MeshSettings(floor=None))
    merged = o3d.io.read_triangle_mesh(folder / 'bun_zipper_res2.ply')
    vertices = np.asarray(merged.vertices)
    distance = Surface(mesh.vertices_xyz, mesh.faces).nearest(vertices).distance
    read = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(mesh.vertices_xyz), o3d.utility.Vector3iVector(mesh.faces)
    )
    components = len(read.cluster_connected_triangles()[1])
    note = f'{len(points)} samples, 95 % {np.percentile(distance, 95) * 1e3:.3f} mm'
    yield Number('bunny, median distance', np.median(distance) * 1e3, 'mm', at_most(0.2), note)
    sound = read.is_edge_manifold(True) and read.is_vertex_manifold()
    yield Number('bunny, 2-manifold', float(sound), '', at_least(1))
    yield Number('bunny, connected components', components, '', at_most(1))
