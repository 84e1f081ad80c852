# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The whole job on one scan, without ROS: pictures in, a mesh out.

Reads like the table of stages: acquisition, noise, views, registration, meshing.
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
from ivfmc_ros.meshing.build import usual_edge
from ivfmc_ros.meshing.io.export import UNITS
from ivfmc_ros.meshing.settings import MeshSettings
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Mesh
from ivfmc_ros.model import Poses
from ivfmc_ros.model import Profile
from ivfmc_ros.model import View
from ivfmc_ros.progress import Progress
from ivfmc_ros.progress import silent
from ivfmc_ros.registration.align import align
from ivfmc_ros.registration.align import METHODS
from ivfmc_ros.registration.align import Verdict
from ivfmc_ros.registration.merge.bodies import Clamping
from ivfmc_ros.registration.merge.merge import merge
from ivfmc_ros.registration.merge.merge import Merged
from ivfmc_ros.registration.merge.merge import require_one_cell
from ivfmc_ros.registration.misfit import laser_misfit
from ivfmc_ros.registration.misfit import Misfit
from ivfmc_ros.registration.self_calibration.parameters import require_groups
from ivfmc_ros.registration.self_calibration.refine import refine
from ivfmc_ros.registration.self_calibration.refine import Refined
from ivfmc_ros.registration.views import assemble as sweeps
from ivfmc_ros.registration.views.motion_fit import Motion
from ivfmc_ros.registration.views.motion_fit import refit
from ivfmc_ros.stopwatch import Stopwatch
from ivfmc_ros.stripe.acquisition import Acquisition
from ivfmc_ros.stripe.acquisition import AcquisitionSettings
from ivfmc_ros.stripe.space_time_stream import stream_of
from ivfmc_ros.validation import require_in_range
from ivfmc_ros.validation import require_one_of

# So many pictures are kept to show what was found.
_SHOWN_PICTURES = 12
# Points of one surface are at most this many point spacings apart.
_REACH = 5.0


@dataclass(frozen=True, kw_only=True)
class Settings:
    """
    How a scan is reconstructed. Lengths are metres.

    island_least : a piece of surface of fewer points is a flying one
    registration : table, paper, point_to_plane or joint
    refine : what of the cell the scan may correct: any of poses, axis, angle, lasers
    mesh : how views become a mesh
    export_unit : of the mesh and cloud files: m, mm or inch
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
    What came out of a scan.

    samples : about a dozen pictures with the points found in them, to look at
    motions : how the table turned while each view was taken
    settings : as used, with what was left to the data decided
    counts : how much of what each stage saw, kept and dropped
    seconds : of each stage
    misfit : how far the lasers see the same surface apart; None if nothing can be compared
    refined : what the scan told of its cell; None if it was not asked
    merged : how several scans were brought together; None if it is one
    """

    samples: list[tuple[Frame, Profile]]
    views: list[View]
    poses: Poses
    verdicts: list[Verdict]
    motions: list[Motion]
    mesh: Mesh
    settings: Settings
    counts: dict[str, int]
    seconds: dict[str, float]
    misfit: Misfit | None = None
    refined: Refined | None = None
    merged: Merged | None = None


def measure(
    cell: Cell,
    frames: Iterable[Frame],
    settings: Settings,
    total: int = 0,
    progress: Progress = silent,
) -> list[Profile]:
    """
    Find the points in the pictures of a scan.

    frames : consumed once, one picture at a time; total : how many, for ``progress``
    :raises CellError: a picture has another size than the calibration
    """
    profiles: list[Profile] = []
    for _, profile in _measured(Acquisition(cell, settings.acquisition), frames, Stopwatch()):
        profiles.append(profile)
        progress('profiles', len(profiles), max(total, len(profiles)))
    return profiles


def reconstruct(
    cell: Cell,
    frames: Iterable[Frame],
    settings: Settings | None = None,
    total: int = 0,
    progress: Progress = silent,
) -> Reconstruction:
    """
    Turn the pictures of a scan into a mesh.

    frames : consumed once, one picture at a time
    total : how many frames there are, for ``progress``
    :raises NoStripeError: no picture shows the stripe in the working volume
    :raises CellError: a picture has another size than the calibration
    :raises GeometryError: the points make no surface
    """
    settings = settings or Settings()
    watch = Stopwatch()
    acquisition = Acquisition(cell, settings.acquisition)
    samples = _Samples()
    profiles = []
    for frame, profile in _measured(acquisition, frames, watch):
        profiles.append(profile)
        samples.add(frame, profile)
        progress('profiles', len(profiles), max(total, len(profiles)))
    settings = replace(settings, acquisition=acquisition.settings)
    work = _Work(settings=settings, watch=watch, counts=acquisition.counts.as_dict())
    return _rebuilt(cell, profiles, samples.shown(), work, progress)


def rebuild(
    cell: Cell,
    profiles: Sequence[Profile],
    settings: Settings | None = None,
    progress: Progress = silent,
) -> Reconstruction:
    """
    Turn the profiles of a scan, which were measured and stored before, into a mesh.

    :raises NoStripeError: no profile has a point
    :raises GeometryError: the points make no surface
    """
    points = sum(len(profile) for profile in profiles)
    counts = {'pictures': len(profiles), 'stripe_points': points}
    work = _Work(settings=settings or Settings(), watch=Stopwatch(), counts=counts)
    return _rebuilt(cell, profiles, [], work, progress)


@dataclass(kw_only=True)
class _Work:
    """What is carried along from stage to stage."""

    settings: Settings
    watch: Stopwatch
    counts: dict[str, int]


def _rebuilt(
    cell: Cell,
    profiles: Sequence[Profile],
    samples: list[tuple[Frame, Profile]],
    work: _Work,
    progress: Progress,
) -> Reconstruction:
    _require_stripe(profiles)
    settings, watch, counts = work.settings, work.watch, work.counts
    with watch.stage('views'):
        progress('views', 0, 1)
        views, motions, found = views_of(cell, profiles, settings)
        counts.update(found)
    with watch.stage('registration'):
        progress('registration', 0, 1)
        refined = refine(cell, views, settings.refine) if settings.refine else None
        if refined is not None:
            cell, views = refined.cell, refined.views
        poses, verdicts = poses_of(cell, views, settings)
        misfit = laser_misfit(views, poses)
    with watch.stage('meshing'):
        progress('meshing', 0, 1)
        mesh, used = mesh_of(cell, views, poses, settings)
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
        refined=refined,
    )


def clamping_of(
    name: str, cell: Cell, profiles: Sequence[Profile], settings: Settings
) -> Clamping:
    """
    Return a scan, named for messages, with its views at their places, to be merged with others.

    :raises NoStripeError: no profile has a point
    """
    _require_stripe(profiles)
    views, _, _ = views_of(cell, profiles, settings)
    if settings.refine:
        refined = refine(cell, views, settings.refine)
        cell, views = refined.cell, refined.views
    poses, _ = poses_of(cell, views, settings)
    return Clamping(name=name, cell=cell, views=views, poses=poses)


def join(
    clampings: Sequence[Clamping], settings: Settings, progress: Progress = silent
) -> Reconstruction:
    """
    Bring several clampings of one part together, and make one mesh, in the frame of the first.

    :raises ParameterError: fewer than two, or of different cells
    :raises GeometryError: one of them finds no place on the others
    :raises AmbiguousError: it fits in several ways, or the surface does not hold it
    """
    require_one_cell(clampings)
    watch = Stopwatch()
    with watch.stage('registration'):
        progress('registration', 0, 1)
        merged = merge(clampings)
    # a part that was seen from below does not end at the platter
    settings = replace(settings, mesh=replace(settings.mesh, floor=None))
    with watch.stage('meshing'):
        progress('meshing', 0, 1)
        mesh, used = mesh_of(clampings[0].cell, merged.views, merged.poses, settings)
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


def views_of(
    cell: Cell, profiles: Sequence[Profile], settings: Settings
) -> tuple[list[View], list[Motion], dict[str, int]]:
    """
    Put profiles into views: the table's motion is fitted, pieces of flying surface go.

    returns : the views by number, how the table turned during each, and how many points went
    :raises GeometryError: a view number holds profiles of two lasers
    """
    turned, motions = refit(profiles)
    views = [_without_islands(view, settings) for view in sweeps.assemble(cell, turned)]
    steady = sum(len(profile) for profile in turned)
    kept = sum(int(np.count_nonzero(view.valid)) for view in views)
    ramps = sum(len(profile) for profile in profiles) - steady
    return views, motions, {'ramps': ramps, 'islands': steady - kept, 'kept_points': kept}


def _measured(
    acquisition: Acquisition, frames: Iterable[Frame], watch: Stopwatch
) -> Iterator[tuple[Frame, Profile]]:
    stream = stream_of(acquisition)
    for frame in watch.each('read', frames):
        with watch.stage('acquisition'):
            measured = stream.add(frame)
        yield from measured
    with watch.stage('acquisition'):
        measured = stream.flush()
    yield from measured


def poses_of(cell: Cell, views: Sequence[View], settings: Settings) -> tuple[Poses, list[Verdict]]:
    """Find where each view belongs, and how sure that is."""
    return align(views, settings.registration)


def mesh_of(
    cell: Cell, views: Sequence[View], poses: Poses, settings: Settings
) -> tuple[Mesh, MeshSettings]:
    """
    Make one mesh of all views.

    returns : the mesh, and the settings as they were used, with ``max_edge``
    :raises GeometryError: the points make no surface
    """
    if not any(math.isfinite(sweeps.spacing(view)) for view in views):
        raise GeometryError(
            f'views: no piece of surface has {settings.island_least} points that hang together; '
            'scan in finer steps or lower island_least'
        )
    used = replace(settings.mesh, max_edge=settings.mesh.max_edge or usual_edge(views))
    return build_mesh(cell, views, poses, used), used


class _Samples:
    """Keeps some of the pictures, evenly, however many come: all of them need gigabytes."""

    def __init__(self) -> None:
        self._kept: list[tuple[Frame, Profile]] = []
        self._stride = 1
        self._count = 0

    def add(self, frame: Frame, profile: Profile) -> None:
        if self._count % self._stride == 0:
            self._kept.append((frame, profile))
        self._count += 1
        if len(self._kept) > 2 * _SHOWN_PICTURES:
            self._kept = self._kept[::2]
            self._stride *= 2

    def shown(self) -> list[tuple[Frame, Profile]]:
        return self._kept[:: max(1, math.ceil(len(self._kept) / _SHOWN_PICTURES))]


def _require_stripe(profiles: Sequence[Profile]) -> None:
    if not profiles:
        raise NoStripeError('the scan has no pictures')
    if not any(len(profile) for profile in profiles):
        raise NoStripeError(
            f'the stripe is seen in none of the {len(profiles)} pictures; check the laser, the '
            'working volume (radius, bottom, top) and min_contrast'
        )


def _without_islands(view: View, settings: Settings) -> View:
    reach = _REACH * sweeps.spacing(view)
    return sweeps.without(view, sweeps.islands(view, reach, settings.island_least))
