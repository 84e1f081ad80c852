# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import re

import cv2
import numpy as np
import pytest
from support.synthetic import small_camera
import yaml

from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.camera_file import save_camera
from ivfmc_ros.errors import CellError
from ivfmc_ros.errors import FileError

# as camera_calibration's "Save" writes it
OST = """\
image_width: 1280
image_height: 1024
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [2351.20712,    0.     ,  642.33811,
            0.     , 2350.69814,  508.90713,
            0.     ,    0.     ,    1.     ]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.051230, 0.013400, 0.000120, -0.000340, 0.000000]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1., 0., 0.,
         0., 1., 0.,
         0., 0., 1.]
projection_matrix:
  rows: 3
  cols: 4
  data: [2340.1,    0.,  642.3,    0.,
            0., 2341.2,  508.9,    0.,
            0.,    0.,    1.,    0.]
"""


@pytest.fixture
def ost(tmp_path):
    """Return a function that writes the file with a piece of its text replaced."""

    def write(old='', new=''):
        assert old in OST
        path = tmp_path / 'ost.yaml'
        path.write_text(OST.replace(old, new, 1) if old else OST)
        return path

    return write


def test_file_of_camera_calibration_is_read(ost):
    camera = load_camera(ost())
    assert camera.size == (1280, 1024)
    assert camera.model == 'plumb_bob'
    assert camera.name == 'narrow_stereo'
    assert np.array_equal(
        camera.K, [[2351.20712, 0, 642.33811], [0, 2350.69814, 508.90713], [0, 0, 1]]
    )
    assert np.array_equal(camera.distortion, [-0.05123, 0.0134, 0.00012, -0.00034, 0.0])


def test_file_of_a_rational_lens_is_read(ost):
    old = OST[OST.index('distortion_model') : OST.index('rectification')]
    new = (
        'distortion_model: rational_polynomial\ndistortion_coefficients:\n  rows: 1\n  cols: 8\n'
        '  data: [6.2, 4.1, 2e-4, -3e-4, 0.25, 6.6, 5.9, 1.1]\n'
    )
    camera = load_camera(ost(old, new))
    assert camera.distortion[2] == 2e-4  # YAML 1.1 takes 2e-4 for a text
    assert len(camera.distortion) == 8


def test_camera_named_by_its_serial_number_is_read(ost):
    assert load_camera(ost('narrow_stereo', '21876543')).name == '21876543'


def test_camera_without_a_name_is_read(ost):
    assert load_camera(ost('camera_name: narrow_stereo\n', '')).name == 'camera'


def test_camera_is_read_as_written(tmp_path):
    rng = np.random.default_rng(1)
    camera = small_camera(
        K=np.array([[1175.0 / 3.0, 0, 319.1], [0, 1174.0 / 7.0, 255.3], [0, 0, 1]]),
        distortion=rng.normal(0, 0.1, 8),
        model='rational_polynomial',
        name='bench',
    )
    save_camera(tmp_path / 'camera.yaml', camera)
    loaded = load_camera(tmp_path / 'camera.yaml')
    assert np.array_equal(loaded.K, camera.K)
    assert np.array_equal(loaded.distortion, camera.distortion)
    assert (loaded.size, loaded.model, loaded.name) == (camera.size, camera.model, camera.name)


def test_written_file_has_what_camera_drivers_look_for(tmp_path):
    save_camera(tmp_path / 'camera.yaml', small_camera())
    document = yaml.safe_load((tmp_path / 'camera.yaml').read_text())
    assert list(document) == list(yaml.safe_load(OST))
    for key, rows, cols in (
        ('camera_matrix', 3, 3),
        ('distortion_coefficients', 1, 5),
        ('rectification_matrix', 3, 3),
        ('projection_matrix', 3, 4),
    ):
        assert (document[key]['rows'], document[key]['cols']) == (rows, cols)
        assert len(document[key]['data']) == rows * cols
    assert np.reshape(document['projection_matrix']['data'], (3, 4))[:, :3].tolist() == (
        small_camera().K.tolist()
    )


@pytest.mark.parametrize('key', ['image_width', 'image_height', 'distortion_model'])
def test_missing_key_is_named(ost, key):
    line = re.search(rf'^{key}.*\n', OST, re.MULTILINE).group()
    with pytest.raises(CellError, match=rf'ost\.yaml: {key}: is missing'):
        load_camera(ost(line, ''))


@pytest.mark.parametrize('key', ['camera_matrix', 'distortion_coefficients'])
def test_missing_matrix_is_named(ost, key):
    with pytest.raises(CellError, match=rf'ost\.yaml: {key}: is missing'):
        load_camera(ost(f'{key}:', f'no_{key}:'))


@pytest.mark.parametrize(
    ('old', 'new', 'problem'),
    [
        ('2351.20712', '.nan', 'camera_matrix: data: nan is not a finite number'),
        ('2351.20712', 'wide', "camera_matrix: data: 'wide' is not a finite number"),
        ('2351.20712', '-2351.2', 'camera_matrix: the focal lengths must be positive'),
        ('642.33811', '1280.0', 'camera_matrix: the principal point lies outside'),
        ('508.90713', '2000.0', 'camera_matrix: the principal point lies outside'),
        ('2351.20712,    0.  ', '2351.20712,    0.5  ', 'camera_matrix: must be'),
        ('0.     ,    1.     ]', '1.     ]', 'camera_matrix: data: must be a list of 9'),
        (', 0.000000]', ', x]', "distortion_coefficients: data: 'x' is not a finite"),
        (
            ', 0.000000]',
            ', 0, 0]',
            'distortion_coefficients: plumb_bob has 5 .* there are 6',
        ),
        (', 0.000000]', ', 0, 1, 0, 0]', 'distortion_coefficients: .* of which 1, 0, 0 must'),
        ('-0.051230', '.inf', 'distortion_coefficients: data: inf is not a finite'),
        ('plumb_bob', 'equidistant', "distortion_model: 'equidistant' is not one of"),
        ('1280', '0', 'image_width: must be a positive whole number'),
        ('1024', '1024.5', 'image_height: must be a positive whole number'),
        ('1024', 'true', 'image_height: must be a positive whole number'),
        ('camera_matrix:\n', 'camera_matrix: 3\nx:\n', 'camera_matrix: must be a mapping'),
        ('image_width', '%YAML:2.0\nimage_width', 'is not YAML'),
        ('image_width', '- image_width', 'is not YAML'),
    ],
)
def test_file_and_key_of_what_is_wrong_are_named(ost, old, new, problem):
    with pytest.raises(CellError, match=rf'ost\.yaml: {problem}'):
        load_camera(ost(old, new))


def test_file_that_is_a_list_is_refused(tmp_path):
    (tmp_path / 'a.yaml').write_text('[1, 2]\n')
    with pytest.raises(CellError, match=r'a\.yaml: must be a mapping'):
        load_camera(tmp_path / 'a.yaml')


def test_picture_in_place_of_the_file_is_refused(tmp_path):
    (tmp_path / 'a.yaml').write_bytes(b'\x89PNG\r\n\x1a\n\xff\xfe\x00')
    with pytest.raises(CellError, match=r'a\.yaml: is a PNG picture'):
        load_camera(tmp_path / 'a.yaml')


def test_missing_file_is_named(tmp_path):
    with pytest.raises(CellError, match=r'none\.yaml: cannot be read: No such file'):
        load_camera(tmp_path / 'none.yaml')


def test_missing_folder_is_named(tmp_path):
    with pytest.raises(FileError, match=r'camera\.yaml: cannot be written'):
        save_camera(tmp_path / 'none' / 'camera.yaml', small_camera())


def opencv_file(path, coefficients, fisheye=0):
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write('calibration_time', 'Mon 01 Jan 2026')
    storage.write('image_width', 640)
    storage.write('image_height', 480)
    storage.write('fisheye_model', fisheye)
    storage.write('camera_matrix', np.array([[600.0, 0, 320], [0, 601, 240], [0, 0, 1]]))
    storage.write('distortion_coefficients', np.array(coefficients).reshape(-1, 1))
    storage.release()
    return path


@pytest.mark.parametrize(
    ('coefficients', 'model'),
    [
        ([0.1, 0.2, 0.01, 0.02], 'plumb_bob'),
        ([0.1, 0.2, 0.01, 0.02, 0.3], 'plumb_bob'),
        ([0.1, 0.2, 0.01, 0.02, 0.3, 0.1, 0.1, 0.1, 0, 0, 0, 0], 'rational_polynomial'),
    ],
)
def test_file_of_opencv_is_read(tmp_path, coefficients, model):
    camera = load_camera(opencv_file(tmp_path / 'cv.yaml', coefficients))
    assert (camera.size, camera.model, camera.K[1, 1]) == ((640, 480), model, 601.0)
    count = min(len(coefficients), len(camera.distortion))
    np.testing.assert_allclose(camera.distortion[:count], coefficients[:count])


def test_fisheye_and_thin_prism_of_opencv_are_refused_by_name(tmp_path):
    with pytest.raises(CellError, match='fisheye_model: must be 0'):
        load_camera(opencv_file(tmp_path / 'a.yaml', [0.1, 0.2, 0.01, 0.02], fisheye=1))
    with pytest.raises(CellError, match='rational_polynomial has 8 numbers'):
        load_camera(opencv_file(tmp_path / 'b.yaml', [0.1] * 12))


def test_byte_order_mark_is_ignored(tmp_path):
    path = opencv_file(tmp_path / 'cv.yaml', [0.1, 0.2, 0.01, 0.02])
    save_camera(tmp_path / 'ros.yaml', load_camera(path))
    for name in ('cv.yaml', 'ros.yaml'):
        marked = tmp_path / f'marked_{name}'
        marked.write_bytes(b'\xef\xbb\xbf' + (tmp_path / name).read_bytes())
        assert load_camera(marked).size == (640, 480)
