# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2
from sensor_msgs.msg import PointField
from support.synthetic import make_profile

from ivfmc_ros.errors import MessageError
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.nodes.convert import clouds
from ivfmc_ros.nodes.convert import images
from ivfmc_ros.nodes.convert import poses
from ivfmc_ros.storage.messages.view_poses import to_poses

FIELDS = ['x', 'y', 'z', 'intensity', 'sigma', 'u', 'v', 'angle', 'laser', 'view', 'seq']


def a_profile(points=None):
    rng = np.random.default_rng(3)
    points = rng.normal(size=(7, 3)) if points is None else points
    return make_profile(points, angle=1.25, laser=1, view=3, seq=99).to_single_precision()


def a_view(number=2):
    rng = np.random.default_rng(4)
    points = rng.normal(size=(5, 4, 3))
    points[1:3, 2] = np.nan
    gone = np.isnan(points[..., 0])
    view = View(
        number=number,
        laser=1,
        points_xyz=points,
        intensity=np.where(gone, np.nan, rng.random((5, 4))),
        sigma=np.where(gone, np.nan, 1e-5),
        uv=np.where(gone[..., None], np.nan, rng.random((5, 4, 2))),
        angles=np.linspace(0.0, 1.0, 4),
        seqs=np.arange(10, 14),
        clamping=1,
    )
    single = {n: getattr(view, n).astype(np.float32) for n in ('points_xyz', 'intensity', 'sigma')}
    return view, single


def test_profile_round_trip():
    profile = a_profile()
    message = clouds.from_profile(profile)
    assert [field.name for field in message.fields if field.name in FIELDS]
    assert set(FIELDS) <= {field.name for field in message.fields}
    assert (message.height, message.width) == (1, 7)
    assert message.header.frame_id == 'turntable'
    back = clouds.to_profile(message, 'profile')
    for name in ('points_xyz', 'intensity', 'sigma', 'uv'):
        np.testing.assert_array_equal(getattr(back, name), getattr(profile, name))
    for name in ('angle', 'laser', 'view', 'seq', 'stamp_ns', 'speed'):
        assert getattr(back, name) == getattr(profile, name)


def test_profile_without_points_is_one_nan_point_with_its_number():
    message = clouds.from_profile(a_profile(np.zeros((0, 3))))
    assert (message.width, message.is_dense) == (1, False)
    back = clouds.to_profile(message, 'profile')
    assert (len(back), back.seq, back.view, back.laser, back.angle) == (0, 99, 3, 1, 1.25)


def test_field_types_are_those_of_the_interface():
    kinds = {field.name: field.datatype for field in clouds.from_profile(a_profile()).fields}
    assert kinds['laser'] == PointField.UINT8
    assert kinds['view'] == PointField.UINT16
    assert kinds['seq'] == PointField.UINT32
    assert {kinds[name] for name in FIELDS[:8]} == {PointField.FLOAT32}


def test_fields_are_read_by_name_in_any_order_and_type():
    profile = a_profile()
    kinds = [(name, '<f8') for name in reversed(FIELDS)]
    records = np.zeros(len(profile), dtype=[('more', '<i2'), *kinds])
    source = clouds.to_structured_array(clouds.from_profile(profile), '', FIELDS).ravel()
    for name in FIELDS:
        records[name] = source[name]
    fields = [
        PointField(name=name, offset=records.dtype.fields[name][1], datatype=code, count=1)
        for name, code in [('more', PointField.INT16), *((n, PointField.FLOAT64) for n in FIELDS)]
    ]
    message = PointCloud2(
        height=1,
        width=len(records),
        fields=fields,
        point_step=records.itemsize,
        row_step=records.nbytes,
        data=images.octets(records.view(np.uint8)),
    )
    back = clouds.to_profile(message, 'profile')
    np.testing.assert_array_equal(back.points_xyz, profile.points_xyz)
    assert back.seq == 99


@pytest.mark.parametrize(
    ('change', 'text'),
    [
        ({'is_bigendian': True}, 'profile: is big-endian'),
        ({'width': 8}, 'are not 1 x 8 points'),
        ({'point_step': 10}, 'points of 10 bytes'),
        ({'row_step': 3}, 'in rows of 3'),
        ({'fields': []}, "field 'x' is missing; fields there: none"),
    ],
)
def test_inconsistent_cloud_is_rejected_by_name(change, text):
    message = clouds.from_profile(a_profile())
    for name, value in change.items():
        setattr(message, name, value)
    with pytest.raises(MessageError, match=text):
        clouds.to_profile(message, 'profile')


def test_field_that_is_no_number_is_rejected_by_name():
    message = clouds.from_profile(a_profile())
    message.fields[0].count = 3
    with pytest.raises(MessageError, match="'x' is not a single number"):
        clouds.to_profile(message, 'profile')


def test_view_round_trip_is_organized():
    view, single = a_view()
    message = clouds.from_view(view, 5)
    assert (message.height, message.width) == (5, 4)
    back = clouds.to_view(message, 'view')
    for name, values in single.items():
        np.testing.assert_array_equal(getattr(back, name).astype(np.float32), values)
    np.testing.assert_array_equal(back.seqs, view.seqs)
    np.testing.assert_allclose(back.angles, view.angles, atol=1e-7)
    assert (back.number, back.laser, back.clamping) == (2, 1, 1)


def test_cloud_of_all_views_has_their_transformed_points():
    view, _ = a_view()
    moved = np.eye(4)
    moved[:3, 3] = (1.0, 2.0, 3.0)
    message = clouds.from_views(
        [view, view], Poses(turntable_from_view=np.stack([np.eye(4), moved])), 5
    )
    records = clouds.to_structured_array(message, 'cloud', ('x', 'view')).ravel()
    count = int(view.valid.sum())
    assert len(records) == 2 * count
    np.testing.assert_allclose(records['x'][count:], records['x'][:count] + 1.0, atol=1e-6)
    assert message.is_dense


def test_poses_are_indexed_by_view_number():
    view, _ = a_view(number=2)
    turn = np.eye(4)
    turn[:2, :2] = [[0.0, -1.0], [1.0, 0.0]]
    turn[:3, 3] = (0.1, 0.2, 0.3)
    message = poses.from_poses([view], Poses(turntable_from_view=turn[None]), 5)
    assert len(message.poses) == 3
    assert message.poses[0].orientation.w == 1.0
    back = to_poses(message, [view], 'view_poses')
    np.testing.assert_allclose(back.turntable_from_view[0], turn, atol=1e-12)


def test_missing_and_invalid_poses_are_rejected():
    view, _ = a_view(number=2)
    message = poses.from_poses([a_view(number=1)[0]], Poses.identity(1), 5)
    with pytest.raises(MessageError, match='none of view 2'):
        to_poses(message, [view], 'view_poses')
    message = poses.from_poses([view], Poses.identity(1), 5)
    message.poses[2].orientation.w = 0.0
    with pytest.raises(MessageError, match='unit quaternion'):
        to_poses(message, [view], 'view_poses')


@pytest.mark.parametrize(
    ('shape', 'kind', 'encoding'),
    [((4, 6), np.uint8, 'mono8'), ((4, 6), np.uint16, 'mono16'), ((4, 6, 3), np.uint8, 'bgr8')],
)
def test_image_round_trip(shape, kind, encoding):
    image = np.random.default_rng(0).integers(0, 255, shape).astype(kind)
    message = images.to_image(image, 1_500_000_000)
    assert message.encoding == encoding
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1, 500_000_000)
    np.testing.assert_array_equal(images.from_image(message, 'image_raw'), image)


def test_jpeg_is_decoded_and_a_truncated_one_rejected():
    image = np.full((32, 32), 77, dtype=np.uint8)
    message = images.to_jpeg(image, 0)
    np.testing.assert_array_equal(images.from_image(message, 'compressed'), image)
    message.data = message.data[:-20]
    with pytest.raises(MessageError, match='compressed'):
        images.from_image(message, 'compressed')
