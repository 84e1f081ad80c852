# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from support.synthetic import draw_stripe
from support.synthetic import expose
from support.synthetic import small_cell
from support.synthetic import Sphere
from support.synthetic import sphere_frames

from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.errors import CellError
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.model import Frame
from ivfmc_ros.stripe.acquisition import Acquisition
from ivfmc_ros.stripe.acquisition import AcquisitionSettings
from ivfmc_ros.stripe.extract import extract
from ivfmc_ros.stripe.extract import ExtractSettings
from ivfmc_ros.stripe.space_time_stream import create_stream
from ivfmc_ros.stripe.stripe import Stripe

SPHERE = Sphere(np.array([0.01, 0.005, 0.04]), 0.02)
BLACK = np.zeros((512, 640), dtype=np.uint8)


def acquisition(**settings):
    return Acquisition(small_cell(), AcquisitionSettings(**settings))


def frame_of(image, **changes):
    return Frame(**{'image': image, 'stamp_ns': 0, 'angle': 0.0, 'seq': 7, **changes})


def test_picture_becomes_points_on_the_part():
    found = acquisition()
    for frame in sphere_frames(small_cell(), SPHERE, 8, seed=1):
        profile = found.profile(frame)
        assert len(profile) > 50
        distance = SPHERE.distance(profile.points_xyz)
        # 0.11 pixel of noise is 0.065 mm along the sheet in this coarse cell
        assert np.sqrt(np.mean(distance**2)) < 0.08e-3
        assert 0.5 < np.sqrt(np.mean((distance / profile.sigma) ** 2)) < 1.25


def test_every_point_is_counted_once():
    (frame, *_) = sphere_frames(small_cell(), SPHERE, 1)
    whole = acquisition()
    count = len(whole.profile(frame))
    assert whole.counts.stripe_points == count + whole.counts.noise
    cut = acquisition(volume=Volume(radius=0.06, bottom=0.045, top=0.1))
    profile = cut.profile(frame)
    assert 0 < len(profile) < count
    assert (profile.points_xyz[:, 2] >= 0.045).all()
    counts = cut.counts.as_dict()
    assert counts['stripe_points'] - counts['outside_volume'] - counts['noise'] == len(profile)
    assert (counts['pictures'], counts['pictures_without_stripe']) == (1, 0)


def with_fan(frame):
    """Return the frame with a broad, bright area beside and on its stripe."""
    stripe = extract(frame.image)
    rows, columns = np.indices(frame.image.shape)
    place = stripe.uv[len(stripe) // 2]
    across, along = (columns - place[0] - 8.0) / 12.0, (rows - place[1]) / 14.0
    light = 120.0 / (1.0 + across**2 + along**2) ** 2
    return replace(frame, image=np.clip(frame.image + light, 0, 255).astype(np.uint8))


def test_light_that_was_reflected_twice_is_noticed_in_the_first_pictures():
    frames = list(sphere_frames(small_cell(), SPHERE, 4, seed=1))
    plain, shiny = acquisition(), acquisition()
    plain.resolve_auto_settings(frames)
    shiny.resolve_auto_settings([with_fan(frame) for frame in frames])
    assert (plain.settings.extract.glare, shiny.settings.extract.glare) == ('auto', 'on')
    assert shiny.settings.extract.expected_width == pytest.approx(
        plain.settings.extract.expected_width, rel=0.3
    )
    profile = shiny.profile(with_fan(frames[0]))
    assert len(profile) > 40
    assert np.abs(SPHERE.distance(profile.points_xyz)).max() < 0.5e-3
    # a picture that shows it later in a scan is noticed, too
    late = plain.profile(with_fan(frames[0]))
    np.testing.assert_array_equal(late.uv[:, 1], profile.uv[:, 1])
    off = acquisition(extract=ExtractSettings(glare='off'))
    off.resolve_auto_settings([with_fan(frame) for frame in frames])
    assert off.settings.extract.glare == 'off'


@pytest.mark.parametrize(
    ('widths', 'method', 'glare'),
    [
        # inter-reflections: uncertain and wide over most of the stripe, thin elsewhere
        ((1.0, 5.0, 5.0), 'gaussian', 'on'),
        # a translucent material: uncertain and wide everywhere
        ((5.0, 5.0, 5.0), 'top_of_peak', 'off'),
    ],
)
def test_metal_is_not_taken_for_a_translucent_material(monkeypatch, widths, method, glare):
    width = np.repeat(widths, 100)
    found = Stripe(
        uv=np.zeros((300, 2)), intensity=np.full(300, 50.0), width=width, sigma=0.35 * width
    )
    scan = acquisition(extract=ExtractSettings(least_width=0.5))
    nothing = np.zeros(300, dtype=bool)
    monkeypatch.setattr(scan, '_everything_found', lambda *_: (found, nothing))
    scan.resolve_auto_settings([frame_of(BLACK)])
    assert (scan.settings.extract.method, scan.settings.extract.glare) == (method, glare)


def test_stripe_on_the_wall_is_no_part():
    # behind the table, outside of the volume, and brighter than the part
    wall = np.stack([np.full(512, 30.0), np.arange(512.0)], axis=1)
    light = draw_stripe(wall, peak=220.0)
    light += draw_stripe(SPHERE.stripe(small_cell(), 0.0), peak=80.0, ambient=0.0)
    profile = acquisition().profile(frame_of(expose(light)))
    assert len(profile) > 80
    assert np.abs(SPHERE.distance(profile.points_xyz)).max() < 0.1e-3


def test_black_picture_is_an_empty_profile_that_is_counted():
    found = acquisition()
    profile = found.profile(frame_of(BLACK, angle=0.5))
    assert len(profile) == 0
    assert (profile.seq, profile.angle) == (7, 0.5)
    assert found.counts.pictures_without_stripe == found.counts.pictures == 1


def colored(image):
    """Green saturates, blue and red do not."""
    light = image.astype(np.float64)
    return np.stack([0.5 * light, 3.0 * light, light], axis=2).clip(0, 255).astype(np.uint8)


def test_colors_are_chosen_by_the_pictures():
    found = acquisition()
    frames = sphere_frames(small_cell(), SPHERE, 3)
    found.resolve_auto_settings(replace(frame, image=colored(frame.image)) for frame in frames)
    assert found.settings.extract.channel == 'blue+red'


def test_colors_are_chosen_by_the_part_and_not_by_the_wall():
    found = acquisition()
    (frame,) = sphere_frames(small_cell(), SPHERE, 1)
    image = np.repeat(frame.image[..., None], 3, axis=2)
    image[:, 20:40, 2] = 255
    found.resolve_auto_settings([replace(frame, image=image)])
    assert found.settings.extract.channel == 'blue+green+red'


def test_colors_of_a_stripe_along_rows_are_chosen_across_it():
    # a level stripe: of the few rows that are lit one is clipped, in one pixel
    cell = small_cell()
    cell = replace(cell, lasers=(replace(cell.lasers[0], stripe='columns'),))
    light = 100.0 * np.exp(-0.5 * ((np.arange(512) - 250.0) / 2.5) ** 2)
    image = np.repeat(np.repeat(light[:, None], 640, axis=1)[..., None], 3, axis=2)
    image[250, 300:304, 1] = 255.0
    image[240:262] *= 1.3
    found = Acquisition(cell, AcquisitionSettings())
    found.resolve_auto_settings([frame_of(image.clip(0, 255).astype(np.uint8))])
    assert found.settings.extract.channel == 'blue+green+red'


def test_chosen_channel_is_not_changed():
    settings = AcquisitionSettings()
    settings = replace(settings, extract=replace(settings.extract, channel='green'))
    found = Acquisition(small_cell(), settings)
    found.resolve_auto_settings([frame_of(colored(BLACK))])
    assert found.settings.extract.channel == 'green'


def test_picture_of_another_size_is_refused():
    small = frame_of(np.zeros((480, 640), dtype=np.uint8))
    with pytest.raises(CellError, match=r'^image 7: the (picture|image) is 640 x 480'):
        acquisition().profile(small)
    with pytest.raises(CellError, match=r'^image 7: the (picture|image) is 640 x 480'):
        acquisition().resolve_auto_settings([small])


@pytest.mark.parametrize('laser', [2, -1])
def test_laser_that_the_cell_does_not_have_is_refused(laser):
    with pytest.raises(CellError, match=rf'^image 7: laser index {laser}, the cell has 2'):
        acquisition().profile(frame_of(BLACK, laser=laser))


@pytest.mark.parametrize('angle', [np.nan, np.inf])
def test_angle_that_is_not_known_is_refused(angle):
    with pytest.raises(GeometryError, match=r'^image 7: the table angle is .*, must be finite'):
        acquisition().profile(frame_of(BLACK, angle=angle))


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('noise_distance', 0.0),
        ('noise_distance', 1.1),
        ('noise_distance', np.nan),
        ('noise_least', 0),
        ('noise_least', 1001),
        ('space_time', 1),
        ('space_time', 101),
    ],
)
def test_setting_out_of_range_is_refused(name, value):
    with pytest.raises(ParameterError, match=rf'^{name}: .* is out of range; it must be'):
        AcquisitionSettings(**{name: value})


def in_low_bits(frame, bits):
    """The frame as a camera of so many bits sends it in 16."""
    return replace(frame, image=(frame.image.astype(np.uint16) * 257) >> (16 - bits))


def profiles(frames, **settings):
    stream = create_stream(acquisition(**settings))
    found = [pair for frame in frames for pair in stream.add(frame)]
    return [profile for _, profile in [*found, *stream.flush()]]


@pytest.mark.parametrize('bits', [10, 12])
def test_camera_of_fewer_bits_in_16_gives_the_points_of_its_full_scale(bits):
    frames = sphere_frames(small_cell(), SPHERE, 6, seed=1)
    settings = ExtractSettings(image_bits=bits)
    expected = profiles(frames)
    found = profiles([in_low_bits(frame, bits) for frame in frames], extract=settings)
    for one, other in zip(found, expected, strict=True):
        assert len(one) == pytest.approx(len(other), abs=3)
        assert one.intensity.mean() == pytest.approx(other.intensity.mean(), rel=0.01)


@pytest.mark.parametrize('space_time', [0, 2])
def test_camera_of_fewer_bits_is_asked_for_their_number(space_time):
    frames = [in_low_bits(frame, 12) for frame in sphere_frames(small_cell(), SPHERE, 4, seed=1)]
    with pytest.raises(ParameterError, match=r'in 4 pictures; the camera looks like 12 bits'):
        profiles(frames, space_time=space_time)


def test_image_with_more_bits_than_said_is_named():
    (frame,) = sphere_frames(small_cell(), SPHERE, 1, seed=1)
    settings = ExtractSettings(image_bits=10)
    with pytest.raises(ParameterError, match=r'image_bits: 10 bits .* image 0 has'):
        profiles([in_low_bits(frame, 12)], extract=settings)


def test_images_that_are_refused_do_not_let_the_next_ones_pass():
    stream = create_stream(acquisition())
    frames = [in_low_bits(f, 12) for f in sphere_frames(small_cell(), SPHERE, 4, seed=1)]
    for _ in range(2):
        for frame in frames:
            assert stream.add(frame) == []
        with pytest.raises(ParameterError, match='12 bits'):
            stream.flush()
