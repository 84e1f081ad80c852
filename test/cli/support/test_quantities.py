# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Lengths and angles on the command line."""

import math

import click
import pytest

from ivfmc_ros.cli.support.quantities import angle
from ivfmc_ros.cli.support.quantities import length


@pytest.mark.parametrize(
    ('text', 'meters'),
    [
        ('60', 0.06),
        ('0.1mm', 1e-4),
        ('1in', 0.0254),
        ('1 inch', 0.0254),
        ('-5', -0.005),
        ('2.5cm', 0.025),
        ('.5m', 0.5),
        ('1e3um', 1e-3),
    ],
)
def test_lengths_are_millimeters_unless_a_unit_is_given(text, meters):
    assert length().convert(text, None, None) == pytest.approx(meters, rel=1e-12)


@pytest.mark.parametrize(
    ('text', 'radians'),
    [('90', math.pi / 2), ('0.2rad', 0.2), ('180 deg', math.pi), ('-45°', -math.pi / 4)],
)
def test_angles_are_degrees_unless_a_unit_is_given(text, radians):
    assert angle().convert(text, None, None) == pytest.approx(radians, rel=1e-12)


@pytest.mark.parametrize('text', ['', 'mm', '5kg', '5 deg', 'nan', 'inf', '1,5', '0x10', '1 2'])
def test_what_is_no_length_is_refused_with_the_units(text):
    with pytest.raises(click.BadParameter, match=r'is not a length.*mm, m, cm'):
        length().convert(text, None, None)


@pytest.mark.parametrize('text', ['5mm', 'right', 'nan'])
def test_what_is_no_angle_is_refused_with_the_units(text):
    with pytest.raises(click.BadParameter, match=r'is not an angle.*deg, °, rad'):
        angle().convert(text, None, None)


@pytest.mark.parametrize(
    ('text', 'limits'),
    [('20000', '0.1 to 10000 mm'), ('20m', '0.0001 to 10 m'), ('0in', '0.00393701 to 393.701 in')],
)
def test_range_is_stated_in_the_unit_that_was_typed(text, limits):
    with pytest.raises(click.BadParameter, match=f'{text} is out of range; it must be {limits}'):
        length(1e-4, 10.0).convert(text, None, None)


def test_one_sided_range_is_stated():
    with pytest.raises(click.BadParameter, match='it must be at least 0 mm'):
        length(0.0).convert('-1', None, None)


def test_range_of_an_angle_is_stated_in_degrees():
    with pytest.raises(click.BadParameter, match='it must be 0 to 180 deg'):
        angle(0.0, math.pi).convert('200', None, None)
