# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The long jobs of registrar and mesher, run in a child process (``worker``). No ROS.

Open3D holds the GIL for most of a call; in the process of a node it would stop the heartbeat. Some
jobs keep a large result in the process for the next one.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ivfmc_ros import pipeline
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import NoStripeError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.files import make_folder
from ivfmc_ros.inspection.reports.scan_page import mesh_figures
from ivfmc_ros.meshing.filters.vertex_clustering import cluster_vertices
from ivfmc_ros.meshing.geometry.cut_rim import rim_figures
from ivfmc_ros.meshing.io import export
from ivfmc_ros.meshing.settings import MeshSettings
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Mesh
from ivfmc_ros.model import Poses
from ivfmc_ros.model import Profile
from ivfmc_ros.model import View
from ivfmc_ros.registration.align import Verdict
from ivfmc_ros.registration.merge.merge import merge
from ivfmc_ros.registration.merge.merge import require_several
from ivfmc_ros.registration.misfit import laser_misfit
from ivfmc_ros.registration.misfit import Misfit
from ivfmc_ros.registration.slip import check_registration
from ivfmc_ros.registration.table_check import TableCheck
from ivfmc_ros.registration.table_check import with_triggers
from ivfmc_ros.registration.views.motion_fit import SweepMotion
from ivfmc_ros.results import merge_report
from ivfmc_ros.stopwatch import Stopwatch
from ivfmc_ros.storage.scans.stored_scan import load_profiles


@dataclass(frozen=True, eq=False, kw_only=True)
class PlacedViews:
    """
    Views with their poses, and how they were found.

    counts : of profiles, views and points; seconds : duration of each step
    """

    views: list[View]
    poses: Poses
    verdicts: list[Verdict]
    motions: list[SweepMotion]
    counts: dict[str, int]
    seconds: dict[str, float]


@dataclass(frozen=True, eq=False, kw_only=True)
class CheckedViews:
    """
    Whether the surfaces of the views agree.

    table : whether lost steps of the table were found
    seconds : duration of each step
    """

    misfit: Misfit | None
    table: TableCheck
    seconds: dict[str, float]


@dataclass(frozen=True, eq=False, kw_only=True)
class RegisteredViews:
    """
    Views with their poses, how they were found, and whether their surfaces agree.

    table : whether lost steps of the table were found
    counts : of profiles, views and points; seconds : duration of each step
    """

    views: list[View]
    poses: Poses
    verdicts: list[Verdict]
    motions: list[SweepMotion]
    misfit: Misfit | None
    table: TableCheck
    counts: dict[str, int]
    seconds: dict[str, float]


@dataclass(kw_only=True)
class _Kept:
    """
    What the last job left in this process.

    cell, placed : of ``place``, for ``check``
    key, mesh, settings, seconds : of ``prepare``, for ``build``
    """

    cell: Cell | None = None
    placed: PlacedViews | None = None
    key: Any = None
    mesh: Mesh | None = None
    settings: MeshSettings | None = None
    seconds: float = 0.0


_kept = _Kept()


@dataclass(frozen=True, kw_only=True)
class MeshOutput:
    """
    What ``build`` makes of a mesh.

    folder : of the files; '' for none
    suffixes : of the files, such as stl
    triangles : maximum number for display
    volume : working volume of the triangulator; None if unknown
    """

    folder: str
    suffixes: Sequence[str]
    triangles: int
    volume: Volume | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class BuiltMesh:
    """
    A mesh, decimated for display, and the files of the full mesh.

    vertices_xyz, faces : (n, 3) meters and (m, 3) vertex indices, decimated
    max_edge : longest edge of a triangle between neighboring points, meters
    surface : which faces were measured, and where the mesh is open
    paths : of the files, by suffix
    """

    vertices_xyz: Floats
    faces: Ints
    max_edge: float | None
    counts: dict[str, int]
    surface: dict[str, Any]
    paths: dict[str, str]
    seconds: dict[str, float]


def register(
    cell: Cell, profiles: Sequence[Profile], settings: pipeline.Settings
) -> RegisteredViews:
    """
    Assemble profiles into views, register the views, and compare their surfaces.

    :raises NoStripeError: no profile has a point
    :raises GeometryError: a view has profiles of two lasers
    """
    placed = place(cell, profiles, settings)
    return registered_views(placed, check())


def registered_views(placed: PlacedViews, checked: CheckedViews) -> RegisteredViews:
    """Return both results as one."""
    seconds = {**placed.seconds, **checked.seconds}
    return RegisteredViews(**{**vars(placed), **vars(checked), 'seconds': seconds})


def place(cell: Cell, profiles: Sequence[Profile], settings: pipeline.Settings) -> PlacedViews:
    """
    Assemble profiles into views and register the views; ``check`` compares their surfaces.

    :raises NoStripeError: no profile has a point
    :raises GeometryError: a view has profiles of two lasers
    """
    if not any(len(profile) for profile in profiles):
        raise NoStripeError(f'none of the {len(profiles)} profiles has a point')
    watch = Stopwatch()
    with watch.stage('views'):
        views, motions, counts = pipeline.assemble_views(cell, profiles, settings)
    with watch.stage('registration'):
        poses, verdicts = pipeline.register_views(views, settings)
    _kept.cell = cell
    _kept.placed = PlacedViews(
        views=views,
        poses=poses,
        verdicts=verdicts,
        motions=motions,
        counts={'profiles': len(profiles), 'views': len(views), **counts},
        seconds=watch.seconds,
    )
    return _kept.placed


def check() -> CheckedViews:
    """
    Compare the surfaces of the views of the last ``place`` in this process.

    :raises ScanError: there was none, such as after a death of the process
    """
    cell, placed = _kept.cell, _kept.placed
    _kept.cell = _kept.placed = None
    if cell is None or placed is None:
        raise ScanError('the process that registered the views has ended; register them again')
    watch = Stopwatch()
    with watch.stage('check'):
        misfit = laser_misfit(placed.views, placed.poses)
        surfaces = check_registration(placed.views, placed.poses, placed.verdicts, cell)
        table = with_triggers(surfaces, placed.motions)
    return CheckedViews(misfit=misfit, table=table, seconds=watch.seconds)


@dataclass(frozen=True, eq=False, kw_only=True)
class MergedScans:
    """
    Views of several clampings in the frame of the first.

    placed : pose and quality of each scan, as in the report of a merge
    """

    views: list[View]
    poses: Poses
    placed: list[dict[str, Any]]
    seconds: dict[str, float]


def merge_scans(root: str, scan_ids: Sequence[str], settings: pipeline.Settings) -> MergedScans:
    """
    Register stored scans of one part to each other.

    root : folder of the scans
    :raises ParameterError: fewer than two scans, a scan twice, or scans of different cells
    :raises CatalogueError: there is no such scan
    :raises GeometryError: no pose of a scan relative to the others was found
    :raises AmbiguousError: several poses of a scan fit equally well
    """
    require_several(scan_ids)
    watch = Stopwatch()
    clampings = []
    with watch.stage('retrieval'):
        stored = [load_profiles(Path(root), scan_id) for scan_id in scan_ids]
    with watch.stage('views'):
        for scan_id, (profiles, cell) in zip(scan_ids, stored, strict=True):
            clampings.append(pipeline.register_clamping(scan_id, cell, profiles, settings))
    with watch.stage('registration'):
        merged = merge(clampings)
    return MergedScans(
        views=merged.views,
        poses=merged.poses,
        placed=merge_report(merged),
        seconds=watch.seconds,
    )


def prepare(
    key: Any, cell: Cell, views: Sequence[View], poses: Poses, settings: pipeline.Settings
) -> None:
    """
    Make the mesh of registered views, and keep it in this process for a ``build`` with this key.

    key : of the views and settings, comparable
    :raises GeometryError: the points determine no surface
    """
    _kept.key = _kept.mesh = None
    watch = Stopwatch()
    with watch.stage('meshing'):
        _kept.mesh, _kept.settings = pipeline.mesh_views(cell, list(views), poses, settings)
    _kept.key, _kept.seconds = key, watch.seconds['meshing']


def _prepared(
    key: Any, cell: Cell, views: Sequence[View], poses: Poses, settings: pipeline.Settings
) -> tuple[Mesh, MeshSettings, float]:
    """Return the mesh, the settings as used, and the seconds; made now unless it is prepared."""
    if key is None or key != _kept.key or _kept.mesh is None:
        prepare(key, cell, views, poses, settings)
    mesh, used = _kept.mesh, _kept.settings
    _kept.key = _kept.mesh = None
    if mesh is None or used is None:
        raise ScanError('the mesh was not made')
    return mesh, used, _kept.seconds


def build(
    cell: Cell,
    views: Sequence[View],
    poses: Poses,
    settings: pipeline.Settings,
    output: MeshOutput,
    key: Any = None,
) -> BuiltMesh:
    """
    Build the mesh of registered views, and write its files.

    key : of a mesh that ``prepare`` may have made; None for none
    :raises GeometryError: the points determine no surface
    :raises FileError: a file exists already, or cannot be written
    """
    folder = output.folder
    paths = {suffix: Path(folder) / f'mesh.{suffix}' for suffix in output.suffixes if folder}
    for path in paths.values():
        if path.exists():
            raise FileError(f'{path}: exists already and is not overwritten')
    watch = Stopwatch()
    mesh, used, seconds = _prepared(key, cell, views, poses, settings)
    with watch.stage('files'), ThreadPoolExecutor() as threads:
        if folder:
            make_folder(Path(folder))
        written = [
            threads.submit(export.write_mesh, path, mesh, settings.export_unit)
            for path in paths.values()
        ]
        vertices, faces = cluster_vertices(mesh.vertices_xyz, mesh.faces, output.triangles)
        surface = _surface_figures(mesh, output.volume)
        for file in written:
            file.result()
    return BuiltMesh(
        vertices_xyz=vertices,
        faces=faces,
        max_edge=used.max_edge,
        counts={
            'views': len(views),
            'vertices': len(mesh.vertices_xyz),
            'faces': len(mesh.faces),
            'shown_faces': len(faces),
        },
        surface=surface,
        paths={suffix: str(path) for suffix, path in paths.items()},
        seconds={'meshing': seconds, **watch.seconds},
    )


def _surface_figures(mesh: Mesh, volume: Volume | None) -> dict[str, Any]:
    figures = mesh_figures(mesh)
    return figures if volume is None else {**figures, 'cut_rim': rim_figures(mesh, volume)}
