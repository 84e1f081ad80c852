# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The whole reconstruction of a scan without ROS: images in, a mesh out.

The stages are acquisition (stripe extraction, triangulation, noise removal), assembly of
profiles into views, registration and meshing. The nodes call the same stages one by one.
"""

from collections.abc import Iterable
from collections.abc import Iterator
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import field
from dataclasses import replace
import math

import numpy as np

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.errors import NoStripeError
from ivfmc_ros.meshing.build import build_mesh
from ivfmc_ros.meshing.build import default_max_edge
from ivfmc_ros.meshing.io.export import UNITS
from ivfmc_ros.meshing.settings import MeshSettings
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Mesh
from ivfmc_ros.model import Poses
from ivfmc_ros.model import Profile
from ivfmc_ros.model import View
from ivfmc_ros.progress import no_progress
from ivfmc_ros.progress import Progress
from ivfmc_ros.registration.align import align
from ivfmc_ros.registration.align import METHODS
from ivfmc_ros.registration.align import Verdict
from ivfmc_ros.registration.merge.bodies import Clamping
from ivfmc_ros.registration.merge.merge import merge
from ivfmc_ros.registration.merge.merge import Merged
from ivfmc_ros.registration.misfit import laser_misfit
from ivfmc_ros.registration.misfit import Misfit
from ivfmc_ros.registration.self_calibration.parameters import require_groups
from ivfmc_ros.registration.self_calibration.refine import refine
from ivfmc_ros.registration.self_calibration.refine import RefinementResult
from ivfmc_ros.registration.slip import check_registration
from ivfmc_ros.registration.table_check import TableCheck
from ivfmc_ros.registration.table_check import with_triggers
from ivfmc_ros.registration.views import assemble as sweeps
from ivfmc_ros.registration.views.motion_fit import refit
from ivfmc_ros.registration.views.motion_fit import SweepMotion
from ivfmc_ros.registration.views.trigger import number_profiles
from ivfmc_ros.stopwatch import Stopwatch
from ivfmc_ros.stripe.acquisition import Acquisition
from ivfmc_ros.stripe.acquisition import AcquisitionSettings
from ivfmc_ros.stripe.clipping import Clipping
from ivfmc_ros.stripe.sample_images import SampleImages
from ivfmc_ros.stripe.sheet_width import SheetVerdict
from ivfmc_ros.stripe.space_time_stream import create_stream
from ivfmc_ros.validation import require_in_range
from ivfmc_ros.validation import require_one_of

_MAX_POINT_GAP = 5.0  # point spacings between neighbors of one connected component


@dataclass(frozen=True, kw_only=True)
class Settings:
    """
    How a scan is reconstructed. Lengths are meters.

    island_least : connected components of a view with fewer points are removed as outliers
    registration : table, paper, point_to_plane or joint
    refine : what of the cell the scan may correct: any of poses, axis, angle, lasers
    mesh : how views become a mesh
    export_unit : of the mesh and cloud files: m, mm or inch
    :raises ParameterError: a value is out of range or not among its choices
    """

    acquisition: AcquisitionSettings = field(default_factory=AcquisitionSettings)
    island_least: int = 100
    registration: str = 'joint'
    refine: tuple[str, ...] = ()
    mesh: MeshSettings = field(default_factory=MeshSettings)
    export_unit: str = 'mm'

    def __post_init__(self) -> None:
        require_one_of('registration', self.registration, METHODS)
        require_groups(self.refine)
        require_in_range('island_least', self.island_least, 1, 1_000_000, 'points')
        require_one_of('export_unit', self.export_unit, UNITS)


@dataclass(frozen=True, eq=False, kw_only=True)
class Reconstruction:
    """
    Result of a reconstruction.

    samples : up to a dozen images with the profiles found in them, for the report
    motions : fitted table motion of each view
    settings : as used, with automatic values replaced by the chosen ones
    counts : number of images, points, views and faces per stage
    seconds : duration of each stage
    misfit : distance between the surfaces of the lasers; None if they share none
    clipping : how the working volume cuts the part; None if it does not
    sheets : whether the light sheets are as thick as when calibrated; None without images, or
        where the material shapes the stripe
    table : whether lost steps of the table were found; None for several scans
    refined : self-calibration of the cell; None if it was not requested
    merged : how several scans were merged; None for a single scan
    """

    samples: list[tuple[Frame, Profile]]
    views: list[View]
    poses: Poses
    verdicts: list[Verdict]
    motions: list[SweepMotion]
    mesh: Mesh
    settings: Settings
    counts: dict[str, int]
    seconds: dict[str, float]
    misfit: Misfit | None = None
    clipping: Clipping | None = None
    sheets: SheetVerdict | None = None
    table: TableCheck | None = None
    refined: RefinementResult | None = None
    merged: Merged | None = None


def measure_profiles(
    cell: Cell,
    frames: Iterable[Frame],
    settings: Settings,
    total: int = 0,
    progress: Progress = no_progress,
) -> list[Profile]:
    """
    Measure the profile of each image of a scan.

    frames : consumed once, one image at a time
    total : number of frames, for ``progress``
    :raises CellError: an image has another size than the calibration
    """
    profiles: list[Profile] = []
    for _, profile in _acquire(Acquisition(cell, settings.acquisition), frames, Stopwatch()):
        profiles.append(profile)
        progress('profiles', len(profiles), max(total, len(profiles)))
    return profiles


def reconstruct(
    cell: Cell,
    frames: Iterable[Frame],
    settings: Settings | None = None,
    total: int = 0,
    progress: Progress = no_progress,
) -> Reconstruction:
    """
    Reconstruct a mesh from the images of a scan.

    frames : consumed once, one image at a time
    total : number of frames, for ``progress``
    :raises NoStripeError: no image shows the stripe in the working volume
    :raises CellError: an image has another size than the calibration
    :raises GeometryError: the points make no surface
    """
    settings = settings or Settings()
    watch = Stopwatch()
    acquisition = Acquisition(cell, settings.acquisition)
    samples = SampleImages()
    profiles = []
    for frame, profile in _acquire(acquisition, frames, watch):
        profiles.append(profile)
        samples.add(frame, profile)
        progress('profiles', len(profiles), max(total, len(profiles)))
    settings = replace(settings, acquisition=acquisition.settings)
    run = _Run(settings=settings, watch=watch, counts=acquisition.counts.as_dict())
    made = _reconstruct(cell, profiles, samples.chosen(), run, progress)
    return replace(made, clipping=acquisition.clipping_with_extent(), sheets=acquisition.sheets())


def reconstruct_profiles(
    cell: Cell,
    profiles: Sequence[Profile],
    settings: Settings | None = None,
    progress: Progress = no_progress,
) -> Reconstruction:
    """
    Reconstruct a mesh from the stored profiles of a scan.

    :raises NoStripeError: no profile has a point
    :raises GeometryError: the points make no surface
    """
    points = sum(len(profile) for profile in profiles)
    counts = {'pictures': len(profiles), 'stripe_points': points}
    run = _Run(settings=settings or Settings(), watch=Stopwatch(), counts=counts)
    return _reconstruct(cell, profiles, [], run, progress)


@dataclass(kw_only=True)
class _Run:
    """Settings, durations and counts that the stages share."""

    settings: Settings
    watch: Stopwatch
    counts: dict[str, int]


def _reconstruct(
    cell: Cell,
    profiles: Sequence[Profile],
    samples: list[tuple[Frame, Profile]],
    run: _Run,
    progress: Progress,
) -> Reconstruction:
    _require_stripe(profiles)
    settings, watch, counts = run.settings, run.watch, run.counts
    with watch.stage('views'):
        progress('views', 0, 1)
        views, motions, found = assemble_views(cell, profiles, settings)
        counts.update(found)
    with watch.stage('registration'):
        progress('registration', 0, 1)
        refined = refine(cell, views, settings.refine) if settings.refine else None
        if refined is not None:
            cell, views = refined.cell, refined.views
        poses, verdicts = register_views(views, settings)
        misfit = laser_misfit(views, poses)
        table = with_triggers(check_registration(views, poses, verdicts, cell), motions)
    with watch.stage('meshing'):
        progress('meshing', 0, 1)
        mesh, used = mesh_views(cell, views, poses, settings)
    counts.update(views=len(views), vertices=len(mesh.vertices_xyz), faces=len(mesh.faces))
    progress('done', 1, 1)
    return Reconstruction(
        samples=samples,
        views=views,
        poses=poses,
        verdicts=verdicts,
        motions=motions,
        mesh=mesh,
        settings=replace(settings, mesh=used),
        counts=counts,
        seconds=watch.seconds,
        misfit=misfit,
        table=table,
        refined=refined,
    )


def register_clamping(
    name: str, cell: Cell, profiles: Sequence[Profile], settings: Settings
) -> Clamping:
    """
    Assemble and register the views of one scan that is to be merged with others.

    name : of the scan, for messages
    :raises NoStripeError: no profile has a point
    :raises GeometryError: the table slipped during the scan, or its trigger is not certain
    """
    _require_stripe(profiles)
    views, motions, _ = assemble_views(cell, profiles, settings)
    if settings.refine:
        refined = refine(cell, views, settings.refine)
        cell, views = refined.cell, refined.views
    poses, verdicts = register_views(views, settings)
    table = with_triggers(check_registration(views, poses, verdicts, cell), motions)
    if table.code in ('SLIPPED', 'TRIGGER_REFUSED'):
        raise GeometryError(f'{name}: {table.detail}')
    return Clamping(name=name, cell=cell, views=views, poses=poses)


def reconstruct_clampings(
    clampings: Sequence[Clamping], settings: Settings, progress: Progress = no_progress
) -> Reconstruction:
    """
    Merge several clampings of one part into one mesh, in the frame of the first.

    The services ``registrar/merge`` and ``mesher/build`` call the same ``merge`` and
    ``mesh_views``.

    :raises ParameterError: fewer than two clampings, or of different cells
    :raises GeometryError: the pose of a clamping is not found
    :raises AmbiguousError: several poses of a clamping fit, or the surface does not determine it
    """
    watch = Stopwatch()
    with watch.stage('registration'):
        progress('registration', 0, 1)
        merged = merge(clampings)
    with watch.stage('meshing'):
        progress('meshing', 0, 1)
        mesh, used = mesh_views(clampings[0].cell, merged.views, merged.poses, settings)
    progress('done', 1, 1)
    return Reconstruction(
        samples=[],
        views=merged.views,
        poses=merged.poses,
        verdicts=[],
        motions=[],
        mesh=mesh,
        settings=replace(settings, mesh=used),
        counts={
            'pictures': sum(len(view.angles) for view in merged.views),
            'kept_points': sum(int(np.count_nonzero(view.valid)) for view in merged.views),
            'views': len(merged.views),
            'vertices': len(mesh.vertices_xyz),
            'faces': len(mesh.faces),
        },
        seconds=watch.seconds,
        misfit=laser_misfit(merged.views, merged.poses),
        merged=merged,
    )


def assemble_views(
    cell: Cell, profiles: Sequence[Profile], settings: Settings
) -> tuple[list[View], list[SweepMotion], dict[str, int]]:
    """
    Fit the table motion, assemble profiles into views and remove small components.

    The angles of a camera that the table triggers are those of the trigger's steps.

    returns : the views by number, the motion of each, and how many points were removed
    :raises GeometryError: a view number holds profiles of two lasers
    """
    fitted, motions = refit(profiles)
    turned, motions = number_profiles(fitted, motions, cell.turntable.trigger_step)
    views = [_without_islands(view, settings) for view in sweeps.assemble(cell, turned)]
    steady = sum(len(profile) for profile in turned)
    kept = sum(int(np.count_nonzero(view.valid)) for view in views)
    between_ramps = sum(len(profile) for profile in fitted)
    ramps = sum(len(profile) for profile in profiles) - between_ramps
    removed = {'ramps': ramps, 'triggers': between_ramps - steady, 'islands': steady - kept}
    return views, motions, {**removed, 'kept_points': kept}


def _acquire(
    acquisition: Acquisition, frames: Iterable[Frame], watch: Stopwatch
) -> Iterator[tuple[Frame, Profile]]:
    stream = create_stream(acquisition)
    for frame in watch.each('read', frames):
        with watch.stage('acquisition'):
            measured = stream.add(frame)
        yield from measured
    with watch.stage('acquisition'):
        measured = stream.flush()
    yield from measured


def register_views(views: Sequence[View], settings: Settings) -> tuple[Poses, list[Verdict]]:
    """Return the pose of each view and how well it is determined."""
    return align(views, settings.registration)


def mesh_views(
    cell: Cell, views: Sequence[View], poses: Poses, settings: Settings
) -> tuple[Mesh, MeshSettings]:
    """
    Make one mesh of all views.

    Views of several clampings show the part from below, too: the platter bounds it in none of
    them, and ``mesh.floor`` is not used.

    returns : the mesh, and the settings as they were used, with ``max_edge``
    :raises GeometryError: the points make no surface
    """
    if not any(math.isfinite(sweeps.spacing(view)) for view in views):
        raise GeometryError(
            f'views: no connected component has {settings.island_least} points; '
            'scan in finer steps or lower island_least'
        )
    used = replace(settings.mesh, max_edge=settings.mesh.max_edge or default_max_edge(views))
    if len({view.clamping for view in views}) > 1:
        used = replace(used, floor=None)
    return build_mesh(cell, views, poses, used), used


def _require_stripe(profiles: Sequence[Profile]) -> None:
    if not profiles:
        raise NoStripeError('the scan has no pictures')
    if not any(len(profile) for profile in profiles):
        raise NoStripeError(
            f'the stripe is found in none of the {len(profiles)} pictures; check the laser, the '
            'working volume (radius, bottom, top) and min_contrast'
        )


def _without_islands(view: View, settings: Settings) -> View:
    max_gap = _MAX_POINT_GAP * sweeps.spacing(view)
    return sweeps.without(view, sweeps.flying_points(view, max_gap, settings.island_least))
