# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The long jobs of registrar and mesher, run in a child process (``worker``). No ROS.

Open3D holds the GIL for most of a call; in the process of a node it would stop the heartbeat.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ivfmc_ros import pipeline
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import NoStripeError
from ivfmc_ros.files import make_folder
from ivfmc_ros.inspection.reports.scan_page import mesh_figures
from ivfmc_ros.meshing.filters.vertex_clustering import cluster_vertices
from ivfmc_ros.meshing.geometry.cut_rim import rim_figures
from ivfmc_ros.meshing.io import export
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
from ivfmc_ros.registration.slip import TableCheck
from ivfmc_ros.registration.views.motion_fit import SweepMotion
from ivfmc_ros.results import merge_report
from ivfmc_ros.stopwatch import Stopwatch
from ivfmc_ros.storage.scans.stored_scan import load_profiles


@dataclass(frozen=True, eq=False, kw_only=True)
class RegisteredViews:
    """
    Views with their poses, and how they were found.

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
    Assemble profiles into views and register the views.

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
        misfit = laser_misfit(views, poses)
        table = check_registration(views, poses, verdicts, cell)
    return RegisteredViews(
        views=views,
        poses=poses,
        verdicts=verdicts,
        motions=motions,
        misfit=misfit,
        table=table,
        counts={'profiles': len(profiles), 'views': len(views), **counts},
        seconds=watch.seconds,
    )


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


def build(
    cell: Cell,
    views: Sequence[View],
    poses: Poses,
    settings: pipeline.Settings,
    folder: str,
    suffixes: Sequence[str],
    triangles: int,
    volume: Volume | None = None,
) -> BuiltMesh:
    """
    Build the mesh of registered views, and write its files into ``folder`` unless that is ''.

    suffixes : of the files, such as stl
    triangles : maximum number for display
    volume : working volume of the triangulator; None if unknown
    :raises GeometryError: the points determine no surface
    :raises FileError: a file exists already, or cannot be written
    """
    paths = {suffix: Path(folder) / f'mesh.{suffix}' for suffix in suffixes if folder}
    for path in paths.values():
        if path.exists():
            raise FileError(f'{path}: exists already and is not overwritten')
    watch = Stopwatch()
    with watch.stage('meshing'):
        mesh, used = pipeline.mesh_views(cell, list(views), poses, settings)
    with watch.stage('files'):
        if folder:
            make_folder(Path(folder))
        for path in paths.values():
            export.write_mesh(path, mesh, settings.export_unit)
    with watch.stage('display'):
        vertices, faces = cluster_vertices(mesh.vertices_xyz, mesh.faces, triangles)
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
        surface=mesh_figures(mesh) if volume is None else _cut_figures(mesh, volume),
        paths={suffix: str(path) for suffix, path in paths.items()},
        seconds=watch.seconds,
    )


def _cut_figures(mesh: Mesh, volume: Volume) -> dict[str, Any]:
    return {**mesh_figures(mesh), 'cut_rim': rim_figures(mesh, volume)}
