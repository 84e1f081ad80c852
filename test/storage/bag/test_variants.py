# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A scan in every format of other recorders is the same scan."""

import pytest
from support.bag_variants import frames_of
from support.bag_variants import is_same
from support.bag_variants import variants
from support.bag_variants import write_scan

VARIANTS = variants()


@pytest.fixture(scope='module')
def source(tmp_path_factory):
    return write_scan(tmp_path_factory.mktemp('ours') / 'bag')


@pytest.mark.parametrize('name', VARIANTS)
def test_scan_is_the_same_in_every_format(source, tmp_path, name):
    path = VARIANTS[name](source, tmp_path / 'theirs')
    assert path.exists()
    assert is_same(frames_of(path), frames_of(source))
