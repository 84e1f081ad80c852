# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from click.testing import CliRunner
import cv2
import numpy as np
import pytest
from support.synthetic import draw_stripe
from support.synthetic import expose

from ivfmc_ros.cli.calibrate.noise import noise
from ivfmc_ros.errors import CalibrationError
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.stripe.noise_file import load_noise

SHAPE = (400, 120)


def write_pictures(folder, turned=False):
    rng = np.random.default_rng(1)
    uv = np.stack([60.0 + np.linspace(-9, 9, SHAPE[0]), np.arange(SHAPE[0])], axis=1)
    for number in range(3):
        image = expose(draw_stripe(uv, SHAPE, peak=60.0 * (number + 1)), rng, speckle=0.15)
        picture = np.ascontiguousarray(image.T) if turned else image
        cv2.imwrite(str(folder / f'{number}.png'), picture)


@pytest.mark.parametrize('stripe', ['rows', 'columns'])
def test_noise_of_a_folder_is_written(tmp_path, stripe):
    write_pictures(tmp_path, turned=stripe == 'columns')
    output = tmp_path / 'noise.yaml'
    arguments = [str(tmp_path), '-o', str(output), '--stripe', stripe]
    result = CliRunner().invoke(noise, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    assert 'speckle contrast' in result.output
    assert load_noise(output).speckle == pytest.approx(0.15, abs=0.02)


def test_noise_of_a_camera_of_12_bits_is_that_of_its_full_scale(tmp_path):
    write_pictures(tmp_path)
    for path in tmp_path.glob('*.png'):
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED).astype(np.uint16) << 4
        cv2.imwrite(str(path), image + 3)
    output = tmp_path / 'noise.yaml'
    asked = CliRunner().invoke(noise, [str(tmp_path), '-o', str(output)])
    assert isinstance(asked.exception, ParameterError)
    assert 'looks like 12 bits' in str(asked.exception)
    arguments = [str(tmp_path), '-o', str(output), '--image-bits', '12']
    assert CliRunner().invoke(noise, arguments, catch_exceptions=False).exit_code == 0
    assert load_noise(output).speckle == pytest.approx(0.15, abs=0.02)


def test_dark_pictures_write_nothing(tmp_path):
    cv2.imwrite(str(tmp_path / '0.png'), np.zeros(SHAPE, dtype=np.uint8))
    output = tmp_path / 'noise.yaml'
    result = CliRunner().invoke(noise, [str(tmp_path), '-o', str(output)])
    assert isinstance(result.exception, CalibrationError)
    assert not output.exists()


def test_empty_folder_is_refused(tmp_path):
    result = CliRunner().invoke(noise, [str(tmp_path)])
    assert isinstance(result.exception, FileError)
