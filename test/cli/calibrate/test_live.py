# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import cv2
import numpy as np
import pytest

from ivfmc_ros.cli.main import main

BOARD = 'chessboard:5x4:10mm'


@pytest.fixture
def run(capsys):
    def call(*words):
        with pytest.raises(SystemExit) as stop:
            main(['calibrate', 'live', *map(str, words), '--board', BOARD, '--once'])
        return stop.value.code, capsys.readouterr()

    return call


def save(path, blur=0.7):
    squares = np.add.outer(np.arange(5), np.arange(6)) % 2 * 170 + 30
    page = np.pad(np.kron(squares, np.ones((30, 30))), 45, constant_values=200)
    cv2.imwrite(str(path), cv2.GaussianBlur(page.astype(np.uint8), (0, 0), blur))


def test_set_that_lacks_pictures_is_refused(run, tmp_path):
    save(tmp_path / '1.png')
    save(tmp_path / '2.png')
    cv2.imwrite(str(tmp_path / '3.png'), np.full((240, 270), 90, dtype=np.uint8))
    code, written = run(tmp_path)
    assert code == 1
    assert '1.png: good' in written.out
    assert '2.png: refused: the board stands as in another picture' in written.out
    assert '3.png: refused: the board is not detected' in written.out
    assert 'missing: tilt the board' in written.out


def test_missing_folder_is_refused(run, tmp_path):
    code, written = run(tmp_path / 'none')
    assert code == 1
    assert 'does not exist' in written.err


def test_picture_of_another_size_is_refused(run, tmp_path):
    save(tmp_path / '1.png')
    cv2.imwrite(str(tmp_path / '2.png'), np.full((100, 100), 90, dtype=np.uint8))
    code, written = run(tmp_path)
    assert code == 1
    assert '2.png' in written.err
    assert '100 x 100' in written.err
