# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import re

import numpy as np
import pytest

from ivfmc_ros.inspection.reports.color_scale import ColorBar
from ivfmc_ros.inspection.reports.color_scale import glsl


def bar(**changes):
    return ColorBar(**{'low': -2e-4, 'high': 2e-4, 'quantity': 'deviation', **changes})


def test_colors_go_from_blue_over_green_to_red_and_end_there():
    low, middle, high, beyond, none = (
        bar().colors(np.array([-2e-4, 0.0, 2e-4, 9e-4, np.nan])).astype(int)
    )
    assert low[0] > 2 * low[2]
    assert middle[1] > max(middle[0], middle[2])
    assert high[2] > 2 * high[0]
    np.testing.assert_array_equal(beyond, high)
    assert np.ptp(none) < 20


def test_tolerance_band_is_marked_at_its_place_with_the_unit():
    html = bar(tolerance=1e-4).svg()
    left, right = map(float, re.search(r'M([\d.]+) 19v-5H([\d.]+)v5', html).groups())
    box = [float(x) for x in re.findall(r'<rect x="([\d.]+)"', html)]
    # +-0.1 mm of +-0.2 mm is the middle half
    start, end = min(box), max(box) + 5.0
    assert left == pytest.approx(start + 0.25 * (end - start), abs=0.6)
    assert right == pytest.approx(start + 0.75 * (end - start), abs=0.6)
    assert 'deviation, mm' in html
    assert re.findall(r'>([+-]?[\d.]+)</text>', html) == [
        '-0.200', '-0.100', '0', '+0.100', '+0.200',
    ]  # fmt: skip


def test_scale_that_begins_at_zero_has_no_signs():
    assert re.findall(r'>([+-]?[\d.]+)</text>', bar(low=0.0, high=1e-5).svg()) == [
        '0', '0.0050', '0.0100',
    ]  # fmt: skip


def test_shader_has_the_colors_of_the_pictures():
    """The body of the shader's function, computed by Python, gives the colors of the pictures."""
    lines = re.sub(r'^.*?\{|return c; \}$|vec3 c =', '', glsl()).split(';')
    start, *mixes = [line.strip().removeprefix('c = ') for line in lines if line.strip()]
    names = {
        'vec3': lambda *rgb: np.array(rgb),
        'mix': lambda a, b, t: a + (b - a) * t,
        'clamp': lambda t, low, high: min(max(t, low), high),
    }
    for share in np.linspace(0.0, 1.0, 21):
        color = eval(start, names)
        for mix in mixes:
            color = eval(mix, {**names, 't': share, 'c': color})
        shown = bar(low=0.0, high=1.0).colors(np.array([share]))[0, ::-1]
        np.testing.assert_allclose(255 * color, shown, atol=1.0)
