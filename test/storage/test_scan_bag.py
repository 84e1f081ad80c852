# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
import time

import numpy as np
import pytest

from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.errors import BagError
from ivfmc_ros.errors import CellError
from ivfmc_ros.storage.bag.writer import BagWriter
from ivfmc_ros.storage.frame_matching import MatchSettings
from ivfmc_ros.storage.messages import build
from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.storage.scan_bag import read_scan

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
STEP = SECOND // 10


def test_scan_comes_back_as_it_was_written(write_bag, camera, picture):
    scan = read_scan(write_bag(count=4))
    assert (scan.frame_count, scan.skipped, scan.damage) == (4, {}, None)
    assert (scan.camera.size, scan.camera.model) == (camera.size, 'plumb_bob')
    np.testing.assert_array_equal(scan.camera.K, camera.K)
    np.testing.assert_array_equal(scan.camera.distortion, camera.distortion)
    for index, frame in enumerate(scan.frames()):
        np.testing.assert_array_equal(frame.image, picture(index))
        assert frame.stamp_ns == START + index * STEP
        assert frame.angle == pytest.approx(0.1 * index, abs=1e-6)  # single precision
        assert (frame.laser, frame.view, frame.seq) == (0, 0, index)


def test_frames_can_be_had_again(write_bag):
    scan = read_scan(write_bag(count=3))
    first, second = list(scan.frames()), list(scan.frames())
    assert [frame.stamp_ns for frame in first] == [frame.stamp_ns for frame in second]


def test_compressed_pictures_are_frames(tmp_path, camera, jpeg):
    with BagWriter(tmp_path / 'bag') as bag:
        bag.joint_state(START, 'turntable_joint', 0.0)
        bag.camera_info(START, camera)
        bag.compressed_image(START, jpeg, 'jpeg')
    [frame] = read_scan(tmp_path / 'bag').frames()
    assert frame.image.shape == (48, 64)


def test_pictures_written_out_of_order_come_by_stamp(tmp_path, camera, picture):
    order = [2, 0, 1, 4, 3, 5]
    with BagWriter(tmp_path / 'bag') as bag:
        bag.joint_state(START, 'turntable_joint', 0.0)
        bag.joint_state(START + 5 * STEP, 'turntable_joint', 0.5)
        bag.camera_info(START, camera)
        for index in order:
            bag.image(START + index * STEP, picture(index))
    frames = list(read_scan(tmp_path / 'bag').frames())
    np.testing.assert_allclose([frame.angle for frame in frames], np.arange(6) / 10)
    assert [frame.seq for frame in frames] == list(range(6))
    for index, frame in enumerate(frames):
        np.testing.assert_array_equal(frame.image, picture(index))


def test_camera_of_the_caller_replaces_that_of_the_bag(write_bag, camera):
    mine = replace(camera, K=camera.K * [[2, 1, 1], [1, 2, 1], [1, 1, 1]])
    assert read_scan(write_bag(infos=False), camera=mine).camera is mine


def _alternating(bag, stamp, index):
    bag.laser_state(stamp - STEP // 2, {'left': index % 2 == 0, 'right': index % 2 == 1})


def test_each_laser_is_a_view(write_bag):
    scan = read_scan(write_bag(before=_alternating), lasers=('left', 'right'))
    frames = list(scan.frames())
    assert [frame.laser for frame in frames] == [0, 1, 0, 1, 0]
    assert [frame.view for frame in frames] == [0, 1, 0, 1, 0]
    assert [frame.seq for frame in frames] == [0, 1, 2, 3, 4]


def test_dark_and_changing_pictures_are_counted_and_left_out(write_bag):
    def before(bag, stamp, index):
        if index == 1:
            bag.laser_state(stamp, {'laser': True})
        if index == 3:
            bag.laser_state(stamp + 5_000_000, {'laser': False})

    scan = read_scan(write_bag(before=before))
    assert scan.skipped == {'lasers not known': 1, 'laser changed': 1, 'laser off': 1}
    assert scan.frame_count == 2
    frames = list(scan.frames())
    assert [frame.seq for frame in frames] == [0, 1]
    np.testing.assert_allclose([frame.angle for frame in frames], [0.1, 0.2])


def cloud(stamp, values):
    """Return a cloud of one point with these fields, all float32 but for the numbers."""
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
        build.POINT_CLOUD,
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


def test_foreign_clouds_called_profile_are_not_heeded(tmp_path, camera, picture):
    with BagWriter(tmp_path / 'bag') as bag:
        bag.camera_info(START, camera)
        bag.joint_state(START, 'turntable_joint', 0.0)
        bag.image(START, picture(0))
        bag.raw('profile', build.POINT_CLOUD, cdr.encode(cloud(START, {})), START)
    assert read_scan(tmp_path / 'bag').frame_count == 1


def test_recorded_profiles_say_which_pictures_are_which(tmp_path, camera, picture):
    with BagWriter(tmp_path / 'bag') as bag:
        bag.camera_info(START, camera)
        for index in range(5):
            stamp = START + index * STEP
            bag.joint_state(stamp, 'turntable_joint', 0.1 * index)
            bag.image(stamp, picture(index))
            if index in (1, 3):
                values = {'view': 10 + index, 'angle': 0.2 + index, 'speed': 0.5, 'seq': index}
                data = cdr.encode(cloud(stamp, values))
                bag.raw('profile', build.POINT_CLOUD, data, stamp)
    scan = read_scan(tmp_path / 'bag')
    assert scan.skipped == {'no profile when recorded': 3}
    frames = list(scan.frames())
    assert [(f.view, f.seq, f.stamp_ns - START) for f in frames] == [
        (11, 0, STEP),
        (13, 1, 3 * STEP),
    ]
    np.testing.assert_allclose([f.angle for f in frames], [1.2, 3.2], atol=1e-6)
    assert [f.speed for f in frames] == [0.5, 0.5]
    # who names rules of his own has every picture judged by them
    assert read_scan(tmp_path / 'bag', matching=MatchSettings()).frame_count == 5


def test_dark_picture_goes_with_those_of_its_stand(tmp_path, camera, picture):
    lit = {0: False, 1: True, 2: True, 4: True}
    with BagWriter(tmp_path / 'bag') as bag:
        bag.camera_info(START, camera)
        for index in range(5):
            stamp = START + index * STEP
            bag.joint_state(stamp, 'turntable_joint', 0.0 if index < 3 else 0.5)
            if index in lit:
                bag.laser_state(stamp, {'laser': lit[index]})
                bag.image(stamp, picture(index))
    scan = read_scan(tmp_path / 'bag', matching=MatchSettings(dark=True, settle=0.0))
    first, second, third = scan.frames()
    np.testing.assert_array_equal(first.dark, picture(0))
    np.testing.assert_array_equal(second.dark, picture(0))
    assert third.dark is None
    assert all(frame.dark is None for frame in read_scan(tmp_path / 'bag').frames())


def test_scan_that_is_all_dark_is_refused(write_bag):
    folder = write_bag(before=lambda bag, stamp, _: bag.laser_state(stamp, {'laser': False}))
    with pytest.raises(BagError, match=r'image_raw: no picture can be used \(5 laser off\)'):
        read_scan(folder)


def test_several_lasers_need_laser_states(write_bag):
    with pytest.raises(BagError, match=r'no topic laser_states .* it has 2 \(left, right\)'):
        read_scan(write_bag(), lasers=('left', 'right'))


def test_missing_joint_states_are_named(write_bag):
    with pytest.raises(BagError, match=r'bag: has no topic joint_states .* it has /ivfmc/camera_'):
        read_scan(write_bag(joints=False))


def test_missing_camera_info_is_named(write_bag):
    with pytest.raises(BagError, match='has no topic camera_info'):
        read_scan(write_bag(infos=False))


def test_missing_joint_is_named(write_bag):
    with pytest.raises(BagError, match=r"joint_states: has no position of joint 'axis'; .*table"):
        read_scan(write_bag(), joint='axis')


def test_picture_outside_the_positions_is_named(tmp_path, write_bag, picture):
    def late(bag, stamp, index):
        if index == 2:
            bag.image(stamp + 10 * SECOND, picture())

    with pytest.raises(BagError, match=r'1 pictures are outside .* at 1700000010\.200000000 s'):
        read_scan(write_bag(before=late))


def test_size_of_picture_and_camera_are_both_named(write_bag, camera):
    wrong = Camera(width=80, height=60, K=camera.K, distortion=camera.distortion)
    scan = read_scan(write_bag(), camera=wrong)
    with pytest.raises(CellError, match=r'image_raw, picture 0 at .* is 64 x 48, .* at 80 x 60'):
        next(scan.frames())


def test_truncated_jpeg_is_named(tmp_path, camera, jpeg):
    with BagWriter(tmp_path / 'bag') as bag:
        bag.camera_info(START, camera)
        for index in range(3):
            bag.joint_state(START + index, 'turntable_joint', 0.0)
            data = jpeg[:-50] if index == 2 else jpeg
            bag.compressed_image(START + index, data, 'jpeg')
    with pytest.raises(
        BagError,
        match=r'/ivfmc/image_raw/compressed, picture 2 at 1700000000\.000000002 s: .* cut off',
    ):
        list(read_scan(tmp_path / 'bag').frames())


def _with_info(tmp_path, camera, picture, **changes):
    info = build.camera_info(START, camera)
    for name, value in changes.items():
        setattr(info, name, value)
    with BagWriter(tmp_path / 'bag') as bag:
        bag.joint_state(START, 'turntable_joint', 0.0)
        bag.raw('camera_info', build.CAMERA_INFO, cdr.encode(info), START)
        bag.image(START, picture())
    return tmp_path / 'bag'


def test_camera_without_distortion_may_leave_it_out(tmp_path, camera, picture):
    folder = _with_info(tmp_path, camera, picture, d=np.empty(0), distortion_model='')
    assert read_scan(folder).camera.distortion.tolist() == [0] * 5


@pytest.mark.parametrize(
    ('changes', 'problem'),
    [
        ({'k': np.zeros(9)}, 'focal lengths must be positive'),
        ({'distortion_model': 'equidistant'}, "'equidistant' is not one of"),
        ({'d': np.ones(4)}, 'plumb_bob has 5 finite numbers'),
        ({'width': 0}, 'is not positive'),
    ],
)
def test_camera_info_that_cannot_be_used_is_named(tmp_path, camera, picture, changes, problem):
    folder = _with_info(tmp_path, camera, picture, **changes)
    with pytest.raises(BagError, match=rf'/ivfmc/camera_info: .*{problem}'):
        read_scan(folder)


def test_damaged_bag_is_refused_before_the_work(write_bag):
    path = write_bag(count=800, compress=False) / 'scan.mcap'
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 2 // 3])
    with pytest.raises(BagError, match=r'scan\.mcap: the file is cut off; \d+ messages can be'):
        read_scan(path)
    scan = read_scan(path, salvage=True)
    assert 'cut off' in scan.damage
    assert 100 < scan.frame_count < 800
    assert sum(1 for _ in scan.frames()) == scan.frame_count


def test_salvage_leaves_out_pictures_without_angle(write_bag, picture):
    def late(bag, stamp, index):
        if index == 2:
            bag.image(stamp + 10 * SECOND, picture())

    scan = read_scan(write_bag(before=late), salvage=True)
    assert scan.skipped == {'no angle': 1}
    assert scan.frame_count == 5


def test_large_pictures_are_read_fast(tmp_path):
    K = np.array([[2350.0, 0, 640], [0, 2350, 512], [0, 0, 1]])
    camera = Camera(width=1280, height=1024, K=K, distortion=np.zeros(5))
    image = np.random.default_rng(0).normal(8, 2, (1024, 1280)).astype(np.uint8)
    with BagWriter(tmp_path / 'bag') as bag:
        bag.camera_info(START, camera)
        for index in range(10):
            bag.joint_state(START + index, 'turntable_joint', 0.0)
            bag.image(START + index, image)
    scan = read_scan(tmp_path / 'bag')
    begin = time.perf_counter()
    assert sum(1 for _ in scan.frames()) == 10
    # 4 ms a picture; the bound is for a machine that is busy
    assert time.perf_counter() - begin < 0.5
