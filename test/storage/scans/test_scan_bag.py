# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
import time

import numpy as np
import pytest

from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.errors import BagError
from ivfmc_ros.errors import CellError
from ivfmc_ros.storage.bag.writer import create_bag
from ivfmc_ros.storage.matching.frame_matching import MatchSettings
from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.storage.messages import sensor_messages
from ivfmc_ros.storage.scans.scan_bag import open_scan

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
STEP = SECOND // 10


def test_scan_is_read_as_it_was_written(write_bag, camera, make_image):
    scan = open_scan(write_bag(count=4))
    assert (scan.frame_count, scan.skipped, scan.damage) == (4, {}, None)
    assert (scan.camera.size, scan.camera.model) == (camera.size, 'plumb_bob')
    np.testing.assert_array_equal(scan.camera.K, camera.K)
    np.testing.assert_array_equal(scan.camera.distortion, camera.distortion)
    for index, frame in enumerate(scan.frames()):
        np.testing.assert_array_equal(frame.image, make_image(index))
        assert frame.stamp_ns == START + index * STEP
        assert frame.angle == pytest.approx(0.1 * index, abs=1e-6)  # single precision
        assert (frame.laser, frame.view, frame.seq) == (0, 0, index)


def test_frames_can_be_read_twice(write_bag):
    scan = open_scan(write_bag(count=3))
    first, second = list(scan.frames()), list(scan.frames())
    assert [frame.stamp_ns for frame in first] == [frame.stamp_ns for frame in second]


def test_compressed_images_are_frames(tmp_path, camera, jpeg):
    with create_bag(tmp_path / 'bag') as bag:
        bag.joint_state(START, 'turntable_joint', 0.0)
        bag.camera_info(START, camera)
        bag.compressed_image(START, jpeg, 'jpeg')
    [frame] = open_scan(tmp_path / 'bag').frames()
    assert frame.image.shape == (48, 64)


def test_images_written_out_of_order_are_read_by_stamp(tmp_path, camera, make_image):
    order = [2, 0, 1, 4, 3, 5]
    with create_bag(tmp_path / 'bag') as bag:
        bag.joint_state(START, 'turntable_joint', 0.0)
        bag.joint_state(START + 5 * STEP, 'turntable_joint', 0.5)
        bag.camera_info(START, camera)
        for index in order:
            bag.image(START + index * STEP, make_image(index))
    frames = list(open_scan(tmp_path / 'bag').frames())
    np.testing.assert_allclose([frame.angle for frame in frames], np.arange(6) / 10)
    assert [frame.seq for frame in frames] == list(range(6))
    for index, frame in enumerate(frames):
        np.testing.assert_array_equal(frame.image, make_image(index))


def test_camera_of_the_caller_replaces_that_of_the_bag(write_bag, camera):
    mine = replace(camera, K=camera.K * [[2, 1, 1], [1, 2, 1], [1, 1, 1]])
    assert open_scan(write_bag(infos=False), camera=mine).camera is mine


def _alternating(bag, stamp, index):
    bag.laser_state(stamp - STEP // 2, {'left': index % 2 == 0, 'right': index % 2 == 1})


def test_each_laser_is_a_view(write_bag):
    scan = open_scan(write_bag(before=_alternating), lasers=('left', 'right'))
    frames = list(scan.frames())
    assert [frame.laser for frame in frames] == [0, 1, 0, 1, 0]
    assert [frame.view for frame in frames] == [0, 1, 0, 1, 0]
    assert [frame.seq for frame in frames] == [0, 1, 2, 3, 4]


def test_images_without_one_laser_are_counted_and_skipped(write_bag):
    def before(bag, stamp, index):
        if index == 1:
            bag.laser_state(stamp, {'laser': True})
        if index == 3:
            bag.laser_state(stamp + 5_000_000, {'laser': False})

    scan = open_scan(write_bag(before=before))
    assert scan.skipped == {'lasers not known': 1, 'laser changed': 1, 'laser off': 1}
    assert scan.frame_count == 2
    frames = list(scan.frames())
    assert [frame.seq for frame in frames] == [0, 1]
    np.testing.assert_allclose([frame.angle for frame in frames], [0.1, 0.2])


def cloud(stamp, values):
    """Return a cloud of one point with these fields; float32 but for view, seq and laser."""
    kinds = {'view': ('<u2', 4), 'seq': ('<u4', 6), 'laser': ('u1', 2)}
    values = {'x': 0.0, 'laser': 0, **values}
    record = np.zeros(1, dtype=[(name, kinds.get(name, ('<f4', 7))[0]) for name in values])
    for name, value in values.items():
        record[name] = value
    fields = [
        cdr.message(
            'sensor_msgs/msg/PointField',
            name=name,
            offset=record.dtype.fields[name][1],
            datatype=kinds.get(name, ('<f4', 7))[1],
            count=1,
        )
        for name in values
    ]
    return cdr.message(
        sensor_messages.POINT_CLOUD,
        header=cdr.header(stamp, 'turntable'),
        height=1,
        width=1,
        fields=fields,
        is_bigendian=False,
        point_step=record.itemsize,
        row_step=record.itemsize,
        data=record.view(np.uint8),
        is_dense=True,
    )


def test_clouds_of_other_programs_on_profile_are_ignored(tmp_path, camera, make_image):
    with create_bag(tmp_path / 'bag') as bag:
        bag.camera_info(START, camera)
        bag.joint_state(START, 'turntable_joint', 0.0)
        bag.image(START, make_image(0))
        bag.write('profile', sensor_messages.POINT_CLOUD, cdr.encode(cloud(START, {})), START)
    assert open_scan(tmp_path / 'bag').frame_count == 1


def test_recorded_profiles_determine_angle_and_view(tmp_path, camera, make_image):
    with create_bag(tmp_path / 'bag') as bag:
        bag.camera_info(START, camera)
        for index in range(5):
            stamp = START + index * STEP
            bag.joint_state(stamp, 'turntable_joint', 0.1 * index)
            bag.image(stamp, make_image(index))
            if index in (1, 3):
                values = {'view': 10 + index, 'angle': 0.2 + index, 'speed': 0.5, 'seq': index}
                data = cdr.encode(cloud(stamp, values))
                bag.write('profile', sensor_messages.POINT_CLOUD, data, stamp)
    scan = open_scan(tmp_path / 'bag')
    assert scan.skipped == {'no profile when recorded': 3}
    frames = list(scan.frames())
    assert [(f.view, f.seq, f.stamp_ns - START) for f in frames] == [
        (11, 0, STEP),
        (13, 1, 3 * STEP),
    ]
    np.testing.assert_allclose([f.angle for f in frames], [1.2, 3.2], atol=1e-6)
    assert [f.speed for f in frames] == [0.5, 0.5]
    # with settings of the caller every image is matched anew
    assert open_scan(tmp_path / 'bag', matching=MatchSettings()).frame_count == 5


def test_dark_frame_is_assigned_at_the_same_position(tmp_path, camera, make_image):
    lit = {0: False, 1: True, 2: True, 4: True}
    with create_bag(tmp_path / 'bag') as bag:
        bag.camera_info(START, camera)
        for index in range(5):
            stamp = START + index * STEP
            bag.joint_state(stamp, 'turntable_joint', 0.0 if index < 3 else 0.5)
            if index in lit:
                bag.laser_state(stamp, {'laser': lit[index]})
                bag.image(stamp, make_image(index))
    scan = open_scan(tmp_path / 'bag', matching=MatchSettings(dark=True, settle=0.0))
    first, second, third = scan.frames()
    np.testing.assert_array_equal(first.dark, make_image(0))
    np.testing.assert_array_equal(second.dark, make_image(0))
    assert third.dark is None
    assert all(frame.dark is None for frame in open_scan(tmp_path / 'bag').frames())


def test_exposures_of_one_position_are_one_frame(tmp_path, camera, make_image):
    with create_bag(tmp_path / 'bag') as bag:
        bag.camera_info(START, camera)
        for index in range(6):
            stamp = START + index * STEP
            bag.joint_state(stamp, 'turntable_joint', 0.5 * (index // 2))
            bag.image(stamp, make_image(index))
    first, *_, last = open_scan(tmp_path / 'bag', taken=MatchSettings(exposures=2)).frames()
    assert (first.seq, last.seq) == (0, 2)
    np.testing.assert_array_equal(first.image, make_image(1))
    (other,) = first.bracket
    np.testing.assert_array_equal(other, make_image(0))
    assert open_scan(tmp_path / 'bag').frame_count == 6


def test_scan_with_lasers_off_is_refused(write_bag):
    folder = write_bag(before=lambda bag, stamp, _: bag.laser_state(stamp, {'laser': False}))
    with pytest.raises(BagError, match=r'image_raw: no image can be used \(5 laser off\)'):
        open_scan(folder)


def test_several_lasers_need_laser_states(write_bag):
    with pytest.raises(BagError, match=r'no topic laser_states .* it has 2 \(left, right\)'):
        open_scan(write_bag(), lasers=('left', 'right'))


def test_bag_without_messages_is_named(write_bag):
    with pytest.raises(BagError, match=r'bag: has no messages; it has no topics'):
        open_scan(write_bag(count=0))


def test_missing_joint_states_are_named(write_bag):
    with pytest.raises(BagError, match=r'bag: has no topic joint_states .* it has /ivfmc/camera_'):
        open_scan(write_bag(joints=False))


def test_missing_camera_info_is_named(write_bag):
    with pytest.raises(BagError, match='has no topic camera_info'):
        open_scan(write_bag(infos=False))


def test_missing_joint_is_named(write_bag):
    with pytest.raises(BagError, match=r"joint_states: has no position of joint 'axis'; .*table"):
        open_scan(write_bag(), joint='axis')


def test_image_outside_the_positions_is_named(tmp_path, write_bag, make_image):
    def late(bag, stamp, index):
        if index == 2:
            bag.image(stamp + 10 * SECOND, make_image())

    with pytest.raises(BagError, match=r'1 images are outside .* at 1700000010\.200000000 s'):
        open_scan(write_bag(before=late))


def test_sizes_of_image_and_camera_are_named(write_bag, camera):
    wrong = Camera(width=80, height=60, K=camera.K, distortion=camera.distortion)
    scan = open_scan(write_bag(), camera=wrong)
    with pytest.raises(CellError, match=r'image_raw, image 0 at .* is 64 x 48, .* at 80 x 60'):
        next(scan.frames())


def test_truncated_jpeg_is_named(tmp_path, camera, jpeg):
    with create_bag(tmp_path / 'bag') as bag:
        bag.camera_info(START, camera)
        for index in range(3):
            bag.joint_state(START + index, 'turntable_joint', 0.0)
            data = jpeg[:-50] if index == 2 else jpeg
            bag.compressed_image(START + index, data, 'jpeg')
    with pytest.raises(
        BagError,
        match=r'/ivfmc/image_raw/compressed, image 2 at 1700000000\.000000002 s: .* cut off',
    ):
        list(open_scan(tmp_path / 'bag').frames())


def _with_info(tmp_path, camera, make_image, **changes):
    info = sensor_messages.camera_info(START, camera)
    for name, value in changes.items():
        setattr(info, name, value)
    with create_bag(tmp_path / 'bag') as bag:
        bag.joint_state(START, 'turntable_joint', 0.0)
        bag.write('camera_info', sensor_messages.CAMERA_INFO, cdr.encode(info), START)
        bag.image(START, make_image())
    return tmp_path / 'bag'


def _roi(**values):
    fields = {'x_offset': 0, 'y_offset': 0, 'height': 0, 'width': 0, 'do_rectify': False}
    return cdr.message('sensor_msgs/msg/RegionOfInterest', **{**fields, **values})


def test_region_and_binning_of_camera_info_are_applied_to_the_camera(tmp_path, camera, make_image):
    roi = _roi(x_offset=8, y_offset=4, width=48, height=40)
    folder = _with_info(tmp_path, camera, make_image, roi=roi, binning_x=2, binning_y=1)
    found = open_scan(folder).camera
    assert found.size == (24, 40)
    # REP 104: (K - offset) / binning
    assert (found.K[0, 0], found.K[0, 2]) == (45.0, (31.5 - 8) / 2)
    assert (found.K[1, 1], found.K[1, 2]) == (91.0, 23.5 - 4)
    np.testing.assert_array_equal(found.distortion, camera.distortion)


@pytest.mark.parametrize(
    ('model', 'count', 'expected'),
    [('plumb_bob', 4, 5), ('plumb_bob', 14, 5), ('rational_polynomial', 5, 8)],
)
def test_distortion_vector_of_opencv_is_completed(
    tmp_path, camera, make_image, model, count, expected
):
    d = np.zeros(count)
    d[:4] = [-0.1, 0.02, 0.001, -0.002]
    folder = _with_info(tmp_path, camera, make_image, d=d, distortion_model=model)
    found = open_scan(folder).camera
    assert (found.model, len(found.distortion)) == (model, expected)
    np.testing.assert_array_equal(found.distortion[:4], d[:4])


def test_camera_info_may_omit_the_distortion(tmp_path, camera, make_image):
    folder = _with_info(tmp_path, camera, make_image, d=np.empty(0), distortion_model='')
    scan = open_scan(folder)
    assert scan.camera.distortion.tolist() == [0] * 5
    assert any('camera_info: states no distortion (d is empty)' in text for text in scan.remarks)
    assert open_scan(folder, camera=camera).remarks == ()


@pytest.mark.parametrize(
    ('changes', 'problem'),
    [
        ({'k': np.zeros(9)}, 'focal lengths must be positive'),
        ({'distortion_model': 'equidistant'}, "'equidistant' is not one of"),
        ({'d': np.ones(3)}, 'plumb_bob has 5 finite numbers, there are 3'),
        ({'d': np.ones(8)}, 'of which 1, 1, 1 must be zero'),
        ({'roi': _roi(x_offset=4)}, r'roi: has an offset \(4, 0\), but no width'),
        ({'roi': _roi(x_offset=40, width=40, height=48)}, r'roi: 40 x 48 at \(40, 0\) does not'),
        ({'roi': _roi(x_offset=40, width=24, height=48)}, 'with roi and binning applied, camera'),
        ({'width': 0}, 'is not positive'),
    ],
)
def test_camera_info_that_cannot_be_used_is_named(tmp_path, camera, make_image, changes, problem):
    folder = _with_info(tmp_path, camera, make_image, **changes)
    with pytest.raises(BagError, match=rf'/ivfmc/camera_info: .*{problem}'):
        open_scan(folder)


def test_damaged_bag_is_refused_before_processing(write_bag):
    path = write_bag(count=800, compress=False) / 'scan.mcap'
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 2 // 3])
    with pytest.raises(BagError, match=r'scan\.mcap: the file is cut off; \d+ messages can be'):
        open_scan(path)
    scan = open_scan(path, salvage=True)
    assert 'cut off' in scan.damage
    assert 100 < scan.frame_count < 800
    assert sum(1 for _ in scan.frames()) == scan.frame_count


def test_salvage_skips_images_without_angle(write_bag, make_image):
    def late(bag, stamp, index):
        if index == 2:
            bag.image(stamp + 10 * SECOND, make_image())

    scan = open_scan(write_bag(before=late), salvage=True)
    assert scan.skipped == {'no angle': 1}
    assert scan.frame_count == 5


def test_large_images_are_read_fast(tmp_path):
    K = np.array([[2350.0, 0, 640], [0, 2350, 512], [0, 0, 1]])
    camera = Camera(width=1280, height=1024, K=K, distortion=np.zeros(5))
    image = np.random.default_rng(0).normal(8, 2, (1024, 1280)).astype(np.uint8)
    with create_bag(tmp_path / 'bag') as bag:
        bag.camera_info(START, camera)
        for index in range(10):
            bag.joint_state(START + index, 'turntable_joint', 0.0)
            bag.image(START + index, image)
    scan = open_scan(tmp_path / 'bag')
    begin = time.process_time()
    assert sum(1 for _ in scan.frames()) == 10
    # 4 ms per image
    assert time.process_time() - begin < 0.5


def test_clocks_that_differ_are_named(tmp_path, camera, make_image):
    with create_bag(tmp_path / 'bag') as bag:
        bag.camera_info(START, camera)
        for index in range(5):
            bag.joint_state(START + index * STEP, 'turntable_joint', 0.1 * index)
            bag.image(START + index * STEP + 3600 * SECOND, make_image(index))
    with pytest.raises(BagError, match=r'images are 3600\.0 s ahead of those of the table; syn'):
        open_scan(tmp_path / 'bag')


def test_clocks_that_differ_within_the_recording_are_said(write_mcap, camera, make_image):
    joints, images = [], []
    for index in range(20):
        stamp = START + index * SECOND
        joints.append(sensor_messages.joint_state(stamp, {'turntable_joint': 0.1 * index}))
        images.append(sensor_messages.image(stamp + 6 * SECOND, make_image(index)))
    path = write_mcap(
        ('/joint_states', sensor_messages.JOINT_STATE, joints),
        ('/image_raw', sensor_messages.IMAGE, images[:12]),
        ('/camera_info', sensor_messages.CAMERA_INFO, [sensor_messages.camera_info(0, camera)]),
    )
    [remark] = open_scan(path).remarks
    assert 'images are 6.0 s ahead of those of the table' in remark


def test_stray_positions_are_said(tmp_path, camera, make_image):
    with create_bag(tmp_path / 'bag') as bag:
        bag.camera_info(START, camera)
        for index in range(100):
            stamp = START + index * STEP // 5
            stray = index in (50, 70)
            bag.joint_state(stamp, 'turntable_joint', 0.0 if stray else 0.02 * index)
            if index % 5 == 0:
                bag.image(stamp, make_image(index))
    scan = open_scan(tmp_path / 'bag')
    assert '2 positions of joint' in scan.remarks[0]
    angles = [frame.angle for frame in scan.frames()]
    np.testing.assert_allclose(angles, 0.1 * np.arange(20), atol=1e-6)


def test_images_that_are_not_stamped_are_named(tmp_path, camera, make_image):
    with create_bag(tmp_path / 'bag') as bag:
        for index in range(4):
            stamp = START + index * SECOND // 10
            bag.joint_state(stamp, 'turntable_joint', 0.1 * index)
            bag.camera_info(stamp, camera)
            bag.image(0, make_image(index))
    with pytest.raises(BagError, match=r'all 4 images have the stamp 0\.0.*header\.stamp'):
        open_scan(tmp_path / 'bag')


def test_second_image_of_a_stamp_is_left_out(tmp_path, camera, make_image):
    with create_bag(tmp_path / 'bag') as bag:
        for index in range(6):
            stamp = START + index * SECOND // 10
            bag.joint_state(stamp, 'turntable_joint', 0.1 * index)
            bag.camera_info(stamp, camera)
            # of every pair the second one was taken later
            bag.image(START + (index // 2) * SECOND // 5, make_image(index))
    scan = open_scan(tmp_path / 'bag')
    assert scan.skipped == {'stamp of another image': 3}
    frames = list(scan.frames())
    assert [frame.angle for frame in frames] == pytest.approx([0.0, 0.2, 0.4])
    for frame, index in zip(frames, (0, 2, 4), strict=True):
        np.testing.assert_array_equal(frame.image, make_image(index))


def test_rectified_images_are_refused(write_mcap, camera, make_image):
    stamps = [START + index * SECOND for index in range(3)]
    joints = [sensor_messages.joint_state(s, {'turntable_joint': 0.1}, 0.0) for s in stamps]
    pictures = [sensor_messages.image(s, make_image(0)) for s in stamps]
    distorted = replace(camera, distortion=np.array([-0.2, 0.0, 0.0, 0.0, 0.0]))
    path = write_mcap(
        ('/cell/image_rect', 'sensor_msgs/msg/Image', pictures),
        ('/joint_states', 'sensor_msgs/msg/JointState', joints),
    )
    with pytest.raises(CellError, match='image_rect: the images are rectified'):
        open_scan(path, camera=distorted, topics={'image': '/cell/image_rect'})
    pinhole = replace(camera, distortion=np.zeros(5))
    assert open_scan(path, camera=pinhole, topics={'image': '/cell/image_rect'}).frame_count == 3
