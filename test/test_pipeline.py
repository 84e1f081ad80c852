# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from support.synthetic import small_cell
from support.synthetic import Sphere
from support.synthetic import sphere_frames

from ivfmc_ros.cell.transforms import rigid
from ivfmc_ros.cell.transforms import rotation_z
from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.errors import CellError
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.errors import NoStripeError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.meshing.geometry.normals import face_normals
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Poses
from ivfmc_ros.pipeline import mesh_views
from ivfmc_ros.pipeline import reconstruct
from ivfmc_ros.pipeline import Settings
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.simulation.render.optics import Optics
from ivfmc_ros.simulation.render.renderer import simulate_scan
from ivfmc_ros.stripe.acquisition import AcquisitionSettings
from ivfmc_ros.surface import Surface

CELL = small_cell()
SPHERE = Sphere(np.array([0.008, -0.005, 0.04]), 0.025)
STEPS = 60
# of this coarse camera, at speckle 0.15: 0.11 pixel times 0.6 mm a pixel in the sheet
RMS = 0.07e-3


def black(count):
    image = np.zeros((512, 640), dtype=np.uint8)
    return [Frame(image=image, stamp_ns=k, angle=0.1 * k, seq=k) for k in range(count)]


@pytest.fixture(scope='module')
def scan():
    return reconstruct(CELL, sphere_frames(CELL, SPHERE, STEPS, seed=1), total=STEPS)


def test_eccentric_sphere_is_rebuilt(scan):
    distance = SPHERE.distance(scan.mesh.vertices_xyz)
    assert np.sqrt(np.mean(distance**2)) < RMS
    # a wrong sense of rotation, half a pixel or a wrong axis would show as a bias
    assert abs(distance.mean()) < 0.1 * RMS
    outward = scan.mesh.vertices_xyz[scan.mesh.faces].mean(axis=1) - SPHERE.center
    facing = (face_normals(scan.mesh.vertices_xyz, scan.mesh.faces) * outward).sum(axis=1)
    assert (facing > 0).mean() > 0.999
    assert len(scan.mesh.faces) > 10_000


def test_counts_of_the_stages_add_up(scan):
    counts = scan.counts
    assert counts['pictures'] == STEPS
    assert counts['views'] == len(scan.views) == len(scan.poses) == len(scan.verdicts) == 1
    left = counts['stripe_points'] - counts['outside_volume'] - counts['noise']
    assert left - counts['islands'] == counts['kept_points']
    assert counts['kept_points'] == sum(len(view.cloud()) for view in scan.views)
    assert counts['vertices'] == len(scan.mesh.vertices_xyz)
    assert counts['faces'] == len(scan.mesh.faces)
    assert set(scan.seconds) == {'read', 'acquisition', 'views', 'registration', 'meshing'}


def test_settings_are_returned_as_used(scan):
    assert scan.settings.mesh.max_edge is not None
    assert 1e-3 < scan.settings.mesh.max_edge < 20e-3
    assert scan.settings.acquisition.extract.channel == 'blue+green+red'


def test_samples_are_spread_over_the_scan(scan):
    seqs = [frame.seq for frame, _ in scan.samples]
    assert 6 <= len(seqs) <= 12
    assert seqs == sorted(set(seqs))
    assert seqs[0] < 6
    assert seqs[-1] > STEPS - 15
    assert all(profile.seq == frame.seq for frame, profile in scan.samples)


def test_simulated_scan_of_a_box_with_two_lasers_is_rebuilt():
    part = box((0.03, 0.04, 0.05)).moved(rigid(rotation_z(0.3), (0.006, -0.004, 0.0)))
    frames = simulate_scan(
        CELL, part, STEPS, optics=Optics(stripe_sigma=1.2), platter=None, seed=3
    )
    found = reconstruct(CELL, frames, Settings(registration='table'), total=2 * STEPS)
    seen = found.mesh.vertices_xyz[np.isfinite(found.mesh.sigma)]
    distance = Surface(part.vertices_xyz, part.faces).signed_distance(seen)
    # the stripe bends over the edges of the box: they are measured worse than its faces
    assert np.median(np.abs(distance)) < 0.03e-3
    assert np.percentile(np.abs(distance), 80) < RMS
    assert np.sqrt(np.mean(distance**2)) < 2.0 * RMS
    assert abs(np.median(distance)) < 0.3 * RMS
    assert [view.laser for view in found.views] == [0, 1]
    sides = face_normals(found.mesh.vertices_xyz, found.mesh.faces)
    turned = sides @ rotation_z(0.3)
    # all of its five visible sides are there, and face outward
    for axis, sense in ((0, 1), (0, -1), (1, 1), (1, -1), (2, 1)):
        assert (sense * turned[:, axis] > 0.95).sum() > 300


def test_laser_without_points_does_not_change_the_other():
    frames = sphere_frames(CELL, SPHERE, 40)
    dark = [replace(frame, laser=1, view=1, seq=40 + frame.seq) for frame in black(40)]
    for order in (frames + dark, dark + frames):
        found = reconstruct(CELL, order, total=80)
        assert len(found.mesh.faces) > 5000
        assert found.settings.mesh.max_edge < 20e-3


def test_frames_are_consumed_one_at_a_time():
    alive = []

    def frames():
        for frame in sphere_frames(CELL, SPHERE, 40) * 3:
            alive.append(1)
            yield frame

    found = reconstruct(CELL, frames())
    assert len(alive) == 120
    # without a total either, only some pictures are kept
    assert len(found.samples) <= 12


def test_progress_reports_the_stages_in_order():
    calls = []
    frames = sphere_frames(CELL, SPHERE, 30)
    reconstruct(CELL, frames, total=30, progress=lambda *now: calls.append(now))
    assert [now for now in calls if now[0] == 'profiles'] == [
        ('profiles', k, 30) for k in range(1, 31)
    ]
    stages = list(dict.fromkeys(stage for stage, _, _ in calls))
    assert stages == ['profiles', 'views', 'registration', 'meshing', 'done']


def test_what_a_sweep_measured_beyond_the_turn_is_no_part_of_the_mesh(scan):
    cell, (view,) = small_cell(), scan.views
    more = 6
    again = {
        name: np.concatenate([values, values[:, :more]], axis=1)
        for name in ('points_xyz', 'intensity', 'sigma', 'uv')
        if (values := getattr(view, name)) is not None
    }
    # the table has slipped: the beginning comes at other places
    again['points_xyz'][:, -more:] @= rotation_z(0.1)
    angles = np.concatenate([view.angles, view.angles[:more] + 2.0 * np.pi])
    seqs = np.concatenate([view.seqs, np.arange(more) + view.seqs.max() + 1])
    longer = replace(view, **again, angles=angles, seqs=seqs)
    mesh, _ = mesh_views(cell, [longer], Poses.identity(1), Settings())
    alone, _ = mesh_views(cell, [view], Poses.identity(1), Settings())
    assert np.array_equal(mesh.vertices_xyz, alone.vertices_xyz)
    assert np.array_equal(mesh.faces, alone.faces)


def test_surface_below_the_platter_is_kept_of_merged_clampings_only(scan):
    # the sphere's center is at z = 40 mm: lowered by that, its lower half is below the platter
    lowered = [
        replace(view, points_xyz=view.points_xyz - SPHERE.center[2] * np.array([0.0, 0.0, 1.0]))
        for view in scan.views
    ]
    settings = Settings()
    clampings = [replace(view, number=1 + view.number, clamping=1) for view in lowered]
    for views, low in ((lowered + lowered, 0.0), (lowered + clampings, -0.01)):
        mesh, used = mesh_views(CELL, views, Poses.identity(len(views)), settings)
        assert (used.floor is None) == (low < 0.0)
        measured = mesh.vertices_xyz[np.isfinite(mesh.sigma)]
        assert measured[:, 2].min() < low + 1e-3
        assert (measured[:, 2].min() < -1e-3) == (low < 0.0)


@pytest.mark.parametrize('method', ['table', 'paper', 'point_to_plane'])
def test_every_registration_runs(method):
    frames = sphere_frames(CELL, SPHERE, 40)
    frames += sphere_frames(CELL, SPHERE, 40, laser=1, view=1, first=40)
    found = reconstruct(CELL, frames, Settings(registration=method))
    # between profiles that are 4 mm apart, the rim of what was seen is uncertain
    seen = found.mesh.vertices_xyz[np.isfinite(found.mesh.sigma)]
    assert np.percentile(np.abs(SPHERE.distance(seen)), 98) < 0.1e-3
    assert found.settings.registration == method


def test_scan_in_which_the_stripe_is_never_seen_is_refused():
    with pytest.raises(NoStripeError, match='none of the 20 pictures; check the laser') as caught:
        reconstruct(CELL, black(20))
    assert caught.value.code == 'NO_STRIPE'


def test_scan_without_pictures_is_refused():
    with pytest.raises(NoStripeError, match='the scan has no pictures'):
        reconstruct(CELL, iter(()))


def test_volume_beside_the_part_is_refused():
    beside = Settings(acquisition=AcquisitionSettings(volume=Volume(bottom=0.08, top=0.1)))
    with pytest.raises(NoStripeError, match=r'working volume \(radius, bottom, top\)'):
        reconstruct(CELL, sphere_frames(CELL, SPHERE, 20), beside)


def test_scan_of_flying_points_only_is_refused():
    (frame,) = sphere_frames(CELL, SPHERE, 1)
    with pytest.raises(GeometryError, match=r'component has 1000 points.* island_least'):
        reconstruct(CELL, [frame], Settings(island_least=1000))


def test_single_profile_is_no_surface():
    (frame,) = sphere_frames(CELL, SPHERE, 1)
    with pytest.raises(GeometryError, match='meshing: no three neighboring points'):
        reconstruct(CELL, [frame])


def test_picture_of_another_size_is_refused():
    frames = sphere_frames(CELL, SPHERE, 20)
    frames[18] = replace(frames[18], image=frames[18].image[:480])
    with pytest.raises(CellError, match=r'^image 18: the picture is 640 x 480'):
        reconstruct(CELL, frames)


@pytest.mark.parametrize(
    ('name', 'value', 'problem'),
    [
        ('registration', 'magic', "'magic' is not one of table, paper, point_to_plane"),
        ('island_least', 0, 'is out of range'),
        ('island_least', 2_000_000, 'is out of range'),
    ],
)
def test_setting_that_cannot_be_used_is_refused(name, value, problem):
    with pytest.raises(ParameterError, match=f'^{name}: .*{problem}'):
        Settings(**{name: value})
