# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from support.synthetic import small_camera

from ivfmc_ros.errors import CellError

# as calibrations of cheap and of wide lenses give them; none folds within the picture
DISTORTIONS = {
    'none': ('plumb_bob', [0.0] * 5),
    'mild': ('plumb_bob', [-0.05, 0.01, 0.0, 0.0, 0.0]),
    'barrel': ('plumb_bob', [-0.38, 0.21, 1.2e-3, -0.8e-3, -0.06]),
    'pincushion': ('plumb_bob', [0.3, -0.1, -1e-3, 2e-3, 0.05]),
    'rational': ('rational_polynomial', [6.2, 4.1, 2e-4, -3e-4, 0.25, 6.6, 5.9, 1.1]),
}


def camera_with(name, focal=500.0):
    model, coefficients = DISTORTIONS[name]
    K = np.array([[focal, 0.0, 330.2], [0.0, 1.01 * focal, 249.7], [0.0, 0.0, 1.0]])
    return small_camera(K=K, model=model, distortion=np.array(coefficients))


def all_over(camera):
    """Pixels from corner to corner, (n, 2)."""
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, 33), np.linspace(0, camera.height - 1, 25))
    return np.stack([u.ravel(), v.ravel()], axis=1)


@pytest.mark.parametrize('name', DISTORTIONS)
def test_rays_are_the_inverse_of_project(name):
    camera = camera_with(name)
    uv = all_over(camera)
    rays = camera.rays(uv)
    assert np.abs(camera.project(rays) - uv).max() < 1e-9
    assert np.array_equal(rays[:, 2], np.ones(len(uv)))


@pytest.mark.parametrize('name', DISTORTIONS)
@pytest.mark.parametrize(('along', 'step'), [('u', (1e-3, 0.0)), ('v', (0.0, 1e-3))])
def test_jacobian_is_the_derivative_of_rays(name, along, step):
    camera = camera_with(name)
    uv = all_over(camera)
    ahead, behind = camera.rays(uv + step), camera.rays(uv - np.array(step))
    jacobian = camera.ray_jacobian(camera.rays(uv), along)
    assert np.abs(jacobian - (ahead - behind) / 2e-3).max() < 1e-6 * np.abs(jacobian).max()


@pytest.mark.parametrize('name', DISTORTIONS)
def test_point_is_seen_in_one_pixel_at_every_depth(name):
    camera = camera_with(name)
    rays = camera.rays(all_over(camera))
    near, far = camera.project(0.1 * rays), camera.project(7.0 * rays)
    assert np.abs(near - far).max() < 1e-9


def test_strong_distortion_moves_the_corner_as_its_formula_says():
    # plumb_bob written out, at x = y = 0.3
    camera = camera_with('barrel')
    k1, k2, p1, p2, k3 = camera.distortion
    x = y = 0.3
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = camera.K[0, 0] * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) + camera.K[0, 2]
    v = camera.K[1, 1] * (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y) + camera.K[1, 2]
    assert np.allclose(camera.project([[0.3, 0.3, 1.0]]), [[u, v]], atol=1e-9)
    assert np.hypot(*(camera.project([[x, y, 1.0]])[0] - (camera.K @ [x, y, 1.0])[:2])) > 10.0


def test_rational_model_divides():
    camera = camera_with('rational')
    k1, k2, p1, p2, k3, k4, k5, k6 = camera.distortion
    x, y = -0.4, 0.2
    r2 = x * x + y * y
    radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
    u = camera.K[0, 0] * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) + camera.K[0, 2]
    assert camera.project([[x, y, 1.0]])[0, 0] == pytest.approx(u, abs=1e-9)


def test_pixel_zero_is_the_center_of_the_first_pixel():
    # a principal point in the middle of 640 pixels is 319.5: the outermost rays are symmetric
    camera = small_camera()
    rays = camera.rays([[0.0, 0.0], [639.0, 511.0]])
    assert np.allclose(rays[0, :2], -rays[1, :2], atol=1e-12)
    assert camera.project([[0.0, 0.0, 1.0]])[0] == pytest.approx([319.5, 255.5], abs=1e-12)


def test_x_is_right_and_y_is_down():
    camera = small_camera()
    here = camera.project([[0.0, 0.0, 0.4]])[0]
    assert (camera.project([[0.01, 0.0, 0.4]])[0] - here)[0] > 0
    assert (camera.project([[0.0, 0.01, 0.4]])[0] - here)[1] > 0


def test_pixel_that_the_lens_cannot_reach_has_no_ray():
    # at k1 = -0.5 the lens folds back at 0.544 focal lengths: what lies beyond sees nothing
    K = np.array([[400.0, 0.0, 319.5], [0.0, 400.0, 255.5], [0.0, 0.0, 1.0]])
    camera = small_camera(K=K, distortion=np.array([-0.5, 0.0, 0.0, 0.0, 0.0]))
    rays = camera.rays([[319.5 + 210.0, 255.5], [319.5 + 230.0, 255.5]])
    assert np.isfinite(rays[0]).all()
    assert np.isnan(rays[1, :2]).all()


def test_empty_arrays_give_empty_arrays():
    camera = small_camera()
    assert camera.rays(np.empty((0, 2))).shape == (0, 3)
    assert camera.project(np.empty((0, 3))).shape == (0, 2)


def matrix(**changes):
    values = {'fx': 500.0, 'fy': 500.0, 'cx': 320.0, 'cy': 256.0, 'skew': 0.0, 'one': 1.0}
    v = {**values, **changes}
    return np.array([[v['fx'], v['skew'], v['cx']], [0.0, v['fy'], v['cy']], [0.0, 0.0, v['one']]])


@pytest.mark.parametrize(
    ('changes', 'problem'),
    [
        ({'width': 0}, 'image size 0 x 512'),
        ({'height': -1}, 'image size 640 x -1'),
        ({'K': matrix(fx=-500.0)}, 'camera_matrix: the focal lengths'),
        ({'K': matrix(fy=0.0)}, 'camera_matrix: the focal lengths'),
        ({'K': matrix(fx=np.nan)}, 'camera_matrix: 9 finite numbers'),
        ({'K': np.eye(4)}, 'camera_matrix: 9 finite numbers'),
        ({'K': matrix(cx=640.0)}, 'camera_matrix: the principal point lies outside'),
        ({'K': matrix(cy=-3.0)}, 'camera_matrix: the principal point lies outside'),
        ({'K': matrix(skew=0.1)}, 'camera_matrix: must be'),
        ({'K': matrix(one=2.0)}, 'camera_matrix: must be'),
        ({'model': 'equidistant'}, "distortion_model: 'equidistant' is not one of plumb_bob"),
        ({'distortion': np.zeros(4)}, 'distortion_coefficients: plumb_bob has 5'),
        ({'distortion': np.zeros(8)}, 'distortion_coefficients: plumb_bob has 5'),
        ({'model': 'rational_polynomial'}, 'rational_polynomial has 8'),
        ({'distortion': np.full(5, np.nan)}, 'distortion_coefficients: plumb_bob has 5 finite'),
    ],
)
def test_impossible_camera_is_refused(changes, problem):
    with pytest.raises(CellError, match=problem):
        small_camera(**changes)


def test_picture_of_another_size_is_refused():
    with pytest.raises(CellError, match=r'^left\.png: .* 1280 x 1024, .* at 640 x 512'):
        small_camera().require_image_size((1024, 1280, 3), 'left.png')


def test_turned_picture_is_refused():
    with pytest.raises(CellError, match='512 x 640'):
        small_camera().require_image_size((640, 512), 'turned.png')


def test_picture_of_the_size_is_taken():
    small_camera().require_image_size((512, 640, 3), 'a.png')
    small_camera().require_image_size((512, 640), 'a.png')
