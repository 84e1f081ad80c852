# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import re

import pytest

from ivfmc_ros.window.recipe_text import recipe_html

RECIPE = """
part: bracket
description: fine & slow
scan: {profiles: 400, lasers: [left, right], motion: step}
inspection:
  nominal: bracket.stl
  tolerance: 0.1
  features: {cylinder 1: {diameter: 0.05, position: 0.2}}
"""


@pytest.fixture
def root(tmp_path):
    (tmp_path / 'bracket.stl').write_bytes(b'solid')
    (tmp_path / 'fine.yaml').write_text(RECIPE)
    return tmp_path


def rows(html):
    return dict(re.findall(r'<th[^>]*>(.*?)</th><td>(.*?)</td>', html))


def test_recipe_is_shown_with_what_it_sets(root):
    html = recipe_html(root, 'fine')
    assert 'fine &amp; slow' in html
    assert rows(html) == {
        'part': 'bracket',
        'profiles': '400',
        'lasers': 'left right',
        'motion': 'step',
        'judged by': 'bracket.stl',
        'tolerance': '±0.1 mm',
        'alignment': 'best fit',
        'cylinder 1': 'diameter 0.05 mm, position 0.2 mm',
    }


def test_recipe_that_was_edited_is_read_again(root):
    recipe_html(root, 'fine')
    (root / 'fine.yaml').write_text('scan: {profiles: 90}')
    assert rows(recipe_html(root, 'fine')) == {'profiles': '90', 'judged': 'no'}


@pytest.mark.parametrize(
    ('text', 'message'), [('scan: {profiles: no}', 'profiles'), ('<b>: 1', '&lt;b&gt;')]
)
def test_recipe_that_cannot_be_used_says_why(root, text, message):
    (root / 'fine.yaml').write_text(text)
    html = recipe_html(root, 'fine')
    assert 'role="alert"' in html
    assert message in html
    assert '<b>' not in html
