# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from support.synthetic import draw_stripe
from support.synthetic import expose

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.stripe.estimators import DEFAULT
from ivfmc_ros.stripe.estimators import METHODS
from ivfmc_ros.stripe.extract import extract
from ivfmc_ros.stripe.extract import ExtractSettings
from ivfmc_ros.stripe.noise import SensorNoise
from ivfmc_ros.stripe.roi import RegionOfInterest

ROWS, COLUMNS = 1000, 160
FIELDS = ('uv', 'intensity', 'width', 'sigma')


def lines(u):
    """The stripe at (n,) columns, one in each row."""
    return np.stack([u, np.arange(len(u), dtype=np.float64)], axis=1)


def phases(count=ROWS):
    """Columns with every fraction of a pixel."""
    return COLUMNS / 2 + np.linspace(-1.0, 1.0, count)


def picture(u, sigma=2.5, rng=None, **light):
    speckle = light.pop('speckle', 0.0)
    drawn = draw_stripe(lines(u), (len(u), COLUMNS), sigma=sigma, **light)
    return expose(drawn, rng, speckle=speckle, ambient=light.get('ambient', 6.0))


def deep_picture(u, sigma):
    light = draw_stripe(lines(u), (len(u), COLUMNS), sigma=sigma)
    return np.rint(light * 257).astype(np.uint16)


@pytest.mark.parametrize('sigma', [1.0, 1.5, 2.5, 4.0, 8.0])
def test_no_fraction_of_a_pixel_is_preferred(sigma):
    # 16 bits: in 8 the rounding of the picture is larger than what is tested
    u = phases()
    found = extract(deep_picture(u, sigma))
    assert np.array_equal(found.uv[:, 1], np.arange(ROWS))
    error = found.uv[:, 0] - u
    assert np.abs(error).max() < 0.01  # a tenth of the noise of the bench
    assert abs(error.mean()) < 1e-4


@pytest.mark.parametrize('sigma', [1.5, 2.5, 4.0])
def test_width_and_height_are_measured(sigma):
    # the height is a mean over three pixels, which takes most of a narrow stripe
    found = extract(picture(phases(), sigma))
    assert found.width == pytest.approx(np.full(ROWS, sigma), rel=0.2)
    assert found.intensity == pytest.approx(np.full(ROWS, 150.0), rel=0.2)


@pytest.mark.parametrize('sigma', [1.0, 2.5, 6.0])
@pytest.mark.parametrize('speckle', [0.0, 0.15])
@pytest.mark.parametrize('peak', [40.0, 150.0])
def test_claimed_sigma_is_true(sigma, speckle, peak):
    rng = np.random.default_rng(1)
    u = phases()
    settings = ExtractSettings(noise=SensorNoise(speckle=speckle))
    found = extract(picture(u, sigma, rng, peak=peak, speckle=speckle), settings=settings)
    error = found.uv[:, 0] - u[found.uv[:, 1].astype(int)]
    assert len(found) > 0.99 * ROWS
    assert 0.8 < error.std() / np.sqrt(np.mean(found.sigma**2)) < 1.25
    assert 0.8 < np.sqrt(np.mean((error / found.sigma) ** 2)) < 1.25
    # five times the standard error of a mean of so many
    assert abs(error.mean()) < 5.0 * error.std() / np.sqrt(ROWS)


def test_bench_stripe_is_found_near_the_noise_limit():
    # shot, read noise and speckle of the bench: the Cramer-Rao bound of this stripe is 0.082 px
    # (sum over pixels of (dI/du)^2 / variance); 1000 rows tell a standard deviation to 2.2 %
    pixels = np.arange(-20.0, 21.0)
    light = 150.0 * np.exp(-0.5 * (pixels / 2.5) ** 2)
    slope = light * pixels / 2.5**2
    bound = (slope**2 / SensorNoise().variance(light + 6.0, light)).sum() ** -0.5
    u = phases()
    found = extract(picture(u, 2.5, np.random.default_rng(2), speckle=0.15))
    error = found.uv[:, 0] - u[found.uv[:, 1].astype(int)]
    assert 0.95 * bound < error.std() < 1.10 * bound


@pytest.mark.parametrize('color', [False, True])
def test_columns_are_rows_of_the_turned_picture(color):
    rng = np.random.default_rng(3)
    image = picture(phases(200), 2.5, rng, speckle=0.15)
    if color:
        image = np.stack([image // 2, image, image // 3], axis=2)
    mask = np.ones(image.shape[:2], dtype=bool)
    mask[50:60] = False
    by_row = extract(image, 'rows', region=RegionOfInterest.of(mask))
    turned = np.ascontiguousarray(np.swapaxes(image, 0, 1))
    by_column = extract(turned, 'columns', region=RegionOfInterest.of(mask.T))
    assert len(by_row) == 190
    assert np.array_equal(by_column.uv, by_row.uv[:, ::-1])
    for name in FIELDS[1:]:
        assert np.array_equal(getattr(by_column, name), getattr(by_row, name))


def test_saturated_color_is_left_out_in_both_directions():
    light = draw_stripe(lines(phases(200)), (200, COLUMNS), peak=120.0)
    image = np.stack([light * 0.8, light * 4.0, light], axis=2).clip(0, 255).astype(np.uint8)
    for direction, turned in (('rows', image), ('columns', np.swapaxes(image, 0, 1).copy())):
        auto = extract(turned, direction)
        chosen = extract(turned, direction, ExtractSettings(channel='blue+red'))
        assert np.array_equal(auto.uv, chosen.uv)


def test_mask_hides_the_brighter_stripe():
    wall = np.full(ROWS, 30.0)
    both = draw_stripe(lines(wall), (ROWS, COLUMNS), peak=200.0)
    both += draw_stripe(lines(phases()), (ROWS, COLUMNS), peak=90.0) - 6.0
    image = expose(both)
    mask = np.zeros(image.shape, dtype=bool)
    mask[:, 70:90] = True
    assert np.abs(extract(image).uv[:, 0] - 30.0).max() < 0.1
    assert np.abs(extract(image, region=RegionOfInterest.of(mask)).uv[:, 0] - phases()).max() < 0.1


def test_method_of_the_paper_finds_the_rows_and_admits_its_error():
    u = phases()
    found = extract(
        picture(u, 2.0, np.random.default_rng(8), speckle=0.15),
        settings=ExtractSettings(method='paper'),
    )
    error = found.uv[:, 0] - u[found.uv[:, 1].astype(int)]
    assert len(found) > 0.95 * ROWS
    # the nearest pixel is as uncertain in any row, which sigma overstates rather than not
    assert 0.5 < error.std() / np.sqrt(np.mean(found.sigma**2)) < 1.25


@pytest.mark.parametrize('left', [0, 25, 45, 70])
def test_what_lies_outside_of_the_region_changes_nothing(left):
    # wherever the region begins, its surroundings are those of the picture
    image = picture(phases(), 4.0, np.random.default_rng(7), speckle=0.15)
    mask = np.zeros(image.shape, dtype=bool)
    mask[100:900, left:100] = True
    whole, cut = extract(image), extract(image, region=RegionOfInterest.of(mask))
    inside = (whole.uv[:, 1] >= 100) & (whole.uv[:, 1] < 900)
    assert np.array_equal(cut.uv[:, 1], whole.uv[inside, 1])
    assert np.abs(cut.uv - whole.uv[inside]).max() < 1e-4


def test_mask_of_nothing_finds_nothing():
    image = picture(phases(50))
    assert len(extract(image, region=RegionOfInterest.of(np.zeros(image.shape, dtype=bool)))) == 0


def test_dim_rows_are_not_found():
    u = phases(100)
    image = picture(u)
    image[40:60] = picture(u[40:60], peak=1.5)
    found = set(extract(image).uv[:, 1].astype(int))
    assert found == set(range(100)) - set(range(40, 60))


def test_contrast_decides_what_is_dim():
    image = picture(phases(50), peak=12.0)
    assert len(extract(image)) == 50
    assert len(extract(image, settings=ExtractSettings(min_contrast=0.06))) == 0


def test_glow_wider_than_a_stripe_is_not_found():
    assert len(extract(picture(phases(50), sigma=14.0))) == 0
    assert len(extract(picture(phases(50), sigma=10.0))) == 50


def test_glow_on_one_side_does_not_lift_the_background():
    u = phases(100)
    light = draw_stripe(lines(u), (100, COLUMNS), peak=120.0)
    light[:, 100:] += 20.0
    error = extract(expose(light)).uv[:, 0] - u
    assert np.abs(error).max() < 0.3


@pytest.mark.parametrize('depth', [8, 16])
def test_black_picture_has_no_stripe(depth):
    assert len(extract(np.zeros((60, 80), dtype=f'uint{depth}'))) == 0


def test_white_picture_has_no_stripe():
    assert len(extract(np.full((60, 80, 3), 255, dtype=np.uint8))) == 0


def test_sixteen_bits_are_measured_as_eight():
    rng = np.random.default_rng(4)
    eight = picture(phases(300), 2.5, rng, speckle=0.15)
    sixteen = eight.astype(np.uint16) * 257
    a, b = extract(eight), extract(sixteen)
    assert np.array_equal(a.uv[:, 1], b.uv[:, 1])
    # the peak is searched in a smoothed picture, rounded to its own gray values: a few rows are
    # fitted from another start
    assert np.abs(a.uv - b.uv).max() < 0.02
    assert np.percentile(np.abs(a.uv - b.uv), 90) < 1e-3
    for name in FIELDS[1:]:
        assert np.allclose(getattr(a, name), getattr(b, name), rtol=0.05)


@pytest.mark.parametrize('mirrored', [False, True])
def test_stripe_that_the_border_cuts_is_not_measured_off_its_center(mirrored):
    u = np.linspace(-6.0, 30.0, 361)
    image = picture(u)
    if mirrored:
        image, u = image[:, ::-1].copy(), COLUMNS - 1 - u
    found = extract(image)
    rows = found.uv[:, 1].astype(int)
    assert np.abs(found.uv[:, 0] - u[rows]).max() < 0.03
    # what lies well inside is found
    inside = (u > 8.0) & (u < COLUMNS - 9.0)
    assert set(np.flatnonzero(inside)) <= set(rows)


@pytest.mark.parametrize('shape', [(1, 1), (3, 2), (40, 5), (5, 400), (60, 80, 3)])
@pytest.mark.parametrize('direction', ['rows', 'columns'])
def test_no_number_is_ever_nan(shape, direction):
    rng = np.random.default_rng(5)
    for _ in range(20):
        image = rng.integers(0, 256, shape).astype(np.uint8)
        image[rng.random(shape) < 0.7] = rng.integers(0, 2) * 255
        found = extract(image, direction, ExtractSettings(min_contrast=0.01))
        for name in FIELDS:
            assert np.isfinite(getattr(found, name)).all()
        assert (found.sigma > 0).all()
        assert (found.uv >= -0.5).all()
        assert (found.uv <= np.array(shape[1::-1]) - 0.5).all()


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('min_contrast', 0.0),
        ('min_contrast', 1.0),
        ('min_contrast', np.nan),
        ('window', 0.9),
        ('window', 5.1),
        ('max_sigma', 0.0),
        ('max_sigma', np.inf),
        ('smoothing', 4),
        ('smoothing', 33),
        ('smoothing', -1),
    ],
)
def test_setting_out_of_range_is_refused(name, value):
    with pytest.raises(ParameterError, match=rf'^{name}: .* is out of range; it must be'):
        ExtractSettings(**{name: value})


@pytest.mark.parametrize('name', ['cyan', 'red+red', 'red,green', '', 'RED'])
def test_channel_that_is_no_color_is_refused(name):
    with pytest.raises(ParameterError, match=r"^channel: '.*' must be 'auto' or colors"):
        ExtractSettings(channel=name)


def test_position_without_an_uncertainty_is_left_out(monkeypatch):
    # seen in a dim live cell: a sigma of 0 has an infinite weight, and the mesh was torn
    whole = extract(picture(phases()))

    def certain(patches, noise):
        found = METHODS['gaussian'](patches, noise)
        return replace(found, sigma=np.where(np.arange(len(found.sigma)) % 2, 0.0, found.sigma))

    monkeypatch.setattr('ivfmc_ros.stripe.extract.METHODS', {**METHODS, DEFAULT: certain})
    some = extract(picture(phases()))
    assert (some.sigma > 0.0).all()
    assert 0 < len(some) <= len(whole) - len(whole) // 2 + 1
