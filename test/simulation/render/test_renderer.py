# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.simulation import bench
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.simulation.parts.solids import cylinder
from ivfmc_ros.simulation.parts.solids import stepped_shaft
from ivfmc_ros.simulation.render.optics import Optics
from ivfmc_ros.simulation.render.renderer import FRAME_PERIOD_NS
from ivfmc_ros.simulation.render.renderer import simulate_scan
from ivfmc_ros.simulation.render.renderer import StripeRenderer
from ivfmc_ros.simulation.render.sources import default_sources

BOX = (0.05, 0.05, 0.06)


@pytest.fixture(scope='module')
def demo_renderer(cell, demo):
    return StripeRenderer(cell=cell, solid=demo, seed=7)


def inner(errors):
    """Leave out the ends of a stripe, where a row sees a part of it."""
    return errors[15:-15]


@pytest.mark.parametrize('laser', [0, 1])
def test_stripe_on_a_flat_side_is_centred_on_the_truth(cell, centroid_errors, laser):
    renderer = StripeRenderer(cell=cell, solid=box(BOX), platter=None)
    truth = renderer.truth(0.3, laser)
    side = truth.points_xyz[:, 2] < BOX[2] - 1e-4
    errors = centroid_errors(renderer.light(0.3, laser), truth)[side]
    assert np.abs(inner(errors)).max() < 0.02
    assert abs(np.median(errors)) < 0.01


def test_stripe_on_a_round_side_is_off_by_its_width_squared(cell, centroid_errors):
    """A curved surface spreads one half of the stripe more: physics, gone for a thin sheet."""
    medians = []
    for sigma in (2.5, 1.25):
        optics = Optics(stripe_sigma=sigma)
        renderer = StripeRenderer(
            cell=cell, solid=cylinder(0.03, 0.06), platter=None, optics=optics
        )
        truth = renderer.truth(0.1, 0)
        side = truth.points_xyz[:, 2] < 0.06 - 1e-4
        errors = centroid_errors(renderer.light(0.1, 0), truth)[side]
        medians.append(np.median(inner(errors)))
    wide, thin = np.abs(medians)
    assert 0.01 < wide < 0.03
    # 1 um between chord and arc is 0.0035 px
    assert thin == pytest.approx(wide / 4, abs=0.0035)


@pytest.mark.parametrize('shift', [0.0, 0.5])
def test_half_a_pixel_would_be_seen(cell, shift):
    """The rendered stripe triangulates to the side of the box only with centered pixels."""
    renderer = StripeRenderer(cell=cell, solid=box(BOX), platter=None)
    light = renderer.light(0.3, 0)
    rows = np.arange(560, 700)
    columns = np.arange(light.shape[1])
    found = (light[rows] * columns).sum(axis=1) / light[rows].sum(axis=1)
    uv = np.stack([found + shift, rows + shift], axis=1)
    points = cell.lasers[0].intersect(cell.camera.rays(uv))
    off = np.abs(cell.turntable.to_part(points, 0.3)[:, 0] - BOX[0] / 2)
    assert (off.max() < 5e-6) == (shift == 0.0)
    assert (off.min() > 5e-5) == (shift == 0.5)


@pytest.mark.parametrize(('angle', 'laser'), [(0.0, 0), (0.5, 1), (2.0, 0)])
def test_band_is_the_whole_picture(cell, demo, demo_renderer, angle, laser):
    whole = StripeRenderer(cell=cell, solid=demo, seed=7, restrict_to_stripe=False)
    assert np.array_equal(whole.light(angle, laser), demo_renderer.light(angle, laser))


def test_band_holds_under_a_strong_lens(demo):
    cell = bench.bench_cell(distortion=(-0.4, 0.2, 1e-3, -1e-3, 0.0))
    band = StripeRenderer(cell=cell, solid=demo)
    whole = StripeRenderer(cell=cell, solid=demo, restrict_to_stripe=False)
    assert np.array_equal(whole.light(1.0, 1), band.light(1.0, 1))


def test_a_part_that_faces_laser_and_camera_has_the_peak_asked_for(cell):
    renderer = StripeRenderer(
        cell=cell, solid=cylinder(0.03, 0.06), platter=None, optics=Optics().without_noise()
    )
    source = cell.turntable.to_part(default_sources(cell)[0].position[None], 0.0)[0]
    point = np.array([0.03 * np.cos(np.radians(36)), 0.03 * np.sin(np.radians(36)), 0.03])
    toward = (source - point) / np.linalg.norm(source - point)
    facing = toward @ (point * (1, 1, 0)) / 0.03
    u, v = np.round(cell.camera.project(cell.turntable.to_camera(point[None], 0.0))[0]).astype(int)
    peak = renderer.render(0.0, 0).image[v, u - 3 : u + 4].max() - 6
    assert peak == pytest.approx(180 * facing, rel=0.03)


def test_part_shades_itself(cell):
    """Under the step the light ends where the line from the source past the rim falls."""
    shaft = stepped_shaft([(0.02, 0.03), (0.04, 0.01)])
    renderer = StripeRenderer(cell=cell, solid=shaft, platter=None)
    base = cell.turntable.to_part(default_sources(cell)[0].position[None], 0.0)[0]
    reach, height = np.hypot(*base[:2]), base[2]
    shadow = 0.03 - (height - 0.03) / (reach - 0.04) * (0.04 - 0.02)
    truth = renderer.truth(0.0, 0)
    x, y, z = truth.points_xyz.T
    below = truth.points_xyz[(np.hypot(x, y) < 0.021) & (z < 0.03)]
    assert below[:, 2].max() == pytest.approx(shadow, abs=2e-4)
    # rows that look at the shaft above the shadow, and below the step
    ambient_light = np.array(
        [[0.02 * np.cos(0.63), 0.02 * np.sin(0.63), z] for z in (0.019, 0.0205)]
    )
    rows = np.round(
        cell.camera.project(cell.turntable.to_camera(ambient_light, 0.0))[:, 1]
    ).astype(int)
    assert renderer.light(0.0, 0)[rows[1] : rows[0]].max() == 0.0


def test_part_hides_the_platter_behind_it(cell, demo):
    bare = StripeRenderer(cell=cell, solid=None).truth(0.0, 0)
    covered = StripeRenderer(cell=cell, solid=demo).truth(0.0, 0)
    assert not bare.on_part.any()
    assert covered.on_part.any()
    hidden = covered.points_xyz[~covered.on_part]
    assert len(hidden) < len(bare)
    assert np.hypot(*hidden[:, :2].T).min() > 0.05


def test_nothing_to_see_is_dark(cell):
    nothing = StripeRenderer(cell=cell, solid=None, platter=None)
    assert nothing.light(0.0, 0).max() == 0.0
    assert len(nothing.truth(0.0, 0)) == 0


def test_pictures_do_not_depend_on_what_was_rendered_before(cell, demo, demo_renderer):
    demo_renderer.render(0.1, 1, seq=3)
    later = demo_renderer.render(0.2, 0, seq=4)
    first = StripeRenderer(cell=cell, solid=demo, seed=7).render(0.2, 0, seq=4)
    assert np.array_equal(later.image, first.image)
    assert later.stamp_ns == first.stamp_ns


def test_seed_and_seq_change_the_noise(cell, demo, demo_renderer):
    one = demo_renderer.render(0.2, 0, seq=4).image
    assert not np.array_equal(one, demo_renderer.render(0.2, 0, seq=5).image)
    other = StripeRenderer(cell=cell, solid=demo, seed=8)
    assert not np.array_equal(one, other.render(0.2, 0, seq=4).image)


def test_laser_off_is_ambient_light(demo_renderer):
    frame = demo_renderer.render_off(0.0, seq=2)
    assert frame.image.mean() == pytest.approx(6.0, abs=0.02)
    assert frame.image.max() < 25


def test_scan_is_a_view_of_one_turn_for_each_laser(cell):
    frames = list(simulate_scan(cell, box(BOX), 3, seed=1))
    assert [frame.seq for frame in frames] == list(range(6))
    assert [frame.view for frame in frames] == [0, 0, 0, 1, 1, 1]
    assert [frame.laser for frame in frames] == [0, 0, 0, 1, 1, 1]
    assert np.diff([frame.angle for frame in frames]) == pytest.approx(2 * np.pi / 3)
    assert set(np.diff([frame.stamp_ns for frame in frames])) == {FRAME_PERIOD_NS}


def test_scan_with_one_laser_numbers_its_view_from_zero(cell):
    frames = list(simulate_scan(cell, box(BOX), 2, lasers=[1]))
    assert [(frame.laser, frame.view) for frame in frames] == [(1, 0), (1, 0)]


def test_scan_without_steps_is_refused(cell):
    with pytest.raises(ParameterError, match='steps'):
        simulate_scan(cell, box(BOX), 0)


def test_laser_that_the_cell_has_not_is_refused(cell, demo_renderer):
    with pytest.raises(ParameterError, match='lasers'):
        simulate_scan(cell, box(BOX), 10, lasers=[2])
    with pytest.raises(ParameterError, match='lasers'):
        demo_renderer.render(0.0, -1)


def test_too_few_sources_are_refused(cell):
    with pytest.raises(ParameterError, match='sources: there are 1 for 2 lasers'):
        StripeRenderer(cell=cell, solid=None, sources=default_sources(cell)[:1])
