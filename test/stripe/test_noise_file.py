# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import math

import pytest

from ivfmc_ros.errors import CellError
from ivfmc_ros.errors import FileError
from ivfmc_ros.stripe.noise import SensorNoise
from ivfmc_ros.stripe.noise_file import load_noise
from ivfmc_ros.stripe.noise_file import save_noise


@pytest.mark.parametrize('shot', [45.0, math.inf])
def test_what_is_saved_is_loaded(tmp_path, shot):
    noise = SensorNoise(read=1.5, electrons_per_dn=shot, speckle=0.12)
    save_noise(tmp_path / 'noise.yaml', noise)
    assert load_noise(tmp_path / 'noise.yaml') == noise


@pytest.mark.parametrize(
    ('text', 'told'),
    [
        ('version: 2\nread: 2\nspeckle: 0.1', 'version: must be 1'),
        ('version: 1\nread: 2', 'speckle: is missing'),
        ('version: 1\nread: 2\nspeckle: 0.1\ngain: 3', "unknown key 'gain'"),
        ('version: 1\nread: -2\nspeckle: 0.1', 'read: -2.0 is out of range'),
    ],
)
def test_impossible_file_is_refused(tmp_path, text, told):
    path = tmp_path / 'noise.yaml'
    path.write_text(text)
    with pytest.raises(FileError, match=told) as error:
        load_noise(path)
    assert str(error.value).startswith(str(path))


def test_missing_file_is_refused(tmp_path):
    with pytest.raises(CellError, match=r'cannot be read'):
        load_noise(tmp_path / 'none.yaml')
