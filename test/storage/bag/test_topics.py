# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
from pathlib import Path

import pytest

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.bag.bag_file import Topic
from ivfmc_ros.storage.bag.reader import Bag
from ivfmc_ros.storage.bag.topics import find_scan_topics
from ivfmc_ros.storage.bag.topics import type_remarks

IMAGE = 'sensor_msgs/msg/Image'
SCAN = {
    '/image_raw': IMAGE,
    '/camera_info': 'sensor_msgs/msg/CameraInfo',
    '/joint_states': 'sensor_msgs/msg/JointState',
}


def _bag(topics, empty=()):
    return Bag(
        path=Path('b.mcap'),
        files=(),
        topics={
            name: Topic(name=name, msgtype=kind, encoding='cdr', count=int(name not in empty))
            for name, kind in topics.items()
        },
    )


@pytest.mark.parametrize('prefix', ['', '/ivfmc', '/a/b'])
def test_topics_are_found_in_any_namespace(prefix):
    roles = find_scan_topics(_bag({prefix + name: kind for name, kind in SCAN.items()}))
    assert roles.image.name == f'{prefix}/image_raw'
    assert roles.joint_states.name == f'{prefix}/joint_states'
    assert roles.camera_info.name == f'{prefix}/camera_info'
    assert roles.laser_states is None


def test_compressed_images_are_found():
    topics = {'/c/image_raw/compressed': 'sensor_msgs/msg/CompressedImage', **SCAN}
    del topics['/image_raw']
    assert find_scan_topics(_bag(topics)).image.name == '/c/image_raw/compressed'


def test_name_of_another_type_or_a_longer_name_does_not_count():
    topics = {
        **SCAN,
        '/x/joint_states': 'std_msgs/msg/String',
        '/my_image_raw': SCAN['/image_raw'],
    }
    assert find_scan_topics(_bag(topics)).joint_states.name == '/joint_states'


def test_old_type_names_are_understood():
    assert (
        find_scan_topics(_bag({**SCAN, '/image_raw': 'sensor_msgs/Image'})).image.name
        == '/image_raw'
    )


COMPRESSED = 'sensor_msgs/msg/CompressedImage'
INFO = SCAN['/camera_info']


@pytest.mark.parametrize(('fewer', 'expected'), [
    ((), '/image_raw'),
    (('/image_raw/compressed',), '/image_raw'),
    (('/image_raw',), '/image_raw/compressed'),
])  # fmt: skip
def test_image_that_was_recorded_twice_is_read_once(fewer, expected):
    bag = _bag({**SCAN, '/image_raw/compressed': COMPRESSED})
    counts = {name: 3 if name in fewer else 40 for name in bag.topics}
    topics = {name: replace(topic, count=counts[name]) for name, topic in bag.topics.items()}
    assert find_scan_topics(replace(bag, topics=topics)).image.name == expected


def test_two_cameras_are_both_named_with_the_option():
    topics = {**SCAN, '/left/image_raw': IMAGE, '/left/image_raw/compressed': COMPRESSED}
    with pytest.raises(BagError, match=r'/image_raw and /left/image_raw could each .* --role im'):
        find_scan_topics(_bag(topics))


def test_topics_are_those_in_the_namespace_of_the_chosen_image():
    lasers = '/laser_states'
    names = {'/cam/image_raw': IMAGE, '/cam/camera_info': INFO, lasers: SCAN['/joint_states']}
    names['/joint_states'] = SCAN['/joint_states']
    topics = {f'/{cell}{name}': kind for cell in 'ab' for name, kind in names.items()}
    with pytest.raises(BagError, match='/a/cam/image_raw and /b/cam/image_raw could each'):
        find_scan_topics(_bag(topics))
    roles = find_scan_topics(_bag(topics), {'image': '/b/cam/image_raw'})
    assert roles.joint_states.name == '/b/joint_states'
    assert roles.camera_info.name == '/b/cam/camera_info'
    assert roles.laser_states.name == '/b/laser_states'


def test_topics_that_no_namespace_tells_apart_are_named():
    topics = {**SCAN, '/robot/joint_states': SCAN['/joint_states']}
    with pytest.raises(BagError, match='/joint_states and /robot/joint_states could each'):
        find_scan_topics(_bag(topics))


def test_only_topic_of_a_type_is_found_and_said():
    topics = {
        '/cam/mono': IMAGE,
        '/cam/mono/compressed': COMPRESSED,
        '/cam/calibration': INFO,
        '/table': SCAN['/joint_states'],
        '/laser_states': SCAN['/joint_states'],
        '/stripe_image/compressed': COMPRESSED,
    }
    bag = _bag(topics)
    roles = find_scan_topics(bag)
    assert (roles.image.name, roles.joint_states.name) == ('/cam/mono', '/table')
    assert (roles.camera_info.name, roles.laser_states.name) == (
        '/cam/calibration',
        '/laser_states',
    )
    said = type_remarks(bag, roles)
    assert len(said) == 3
    assert '/cam/mono is read as image: it is the only topic of its type' in said[0]
    chosen = {'image': '/cam/mono', 'camera_info': '/cam/calibration'}
    assert len(type_remarks(bag, find_scan_topics(bag, chosen), chosen)) == 1
    assert type_remarks(_bag(SCAN), find_scan_topics(_bag(SCAN))) == []


def test_calibration_of_another_camera_is_not_taken_by_its_type():
    topics = {**SCAN, '/right/calibration': INFO}
    del topics['/camera_info']
    assert find_scan_topics(_bag(topics)).camera_info is None


def test_two_topics_of_a_type_are_both_named():
    topics = {**SCAN, '/left': IMAGE, '/right': IMAGE}
    del topics['/image_raw']
    with pytest.raises(BagError, match='/left and /right could each be the image topic'):
        find_scan_topics(_bag(topics))


def test_camera_info_is_that_of_the_chosen_camera():
    topics = {**SCAN, '/left/image_raw': IMAGE, '/left/camera_info': INFO}
    for image, info in (('/left/image_raw', '/left/camera_info'), ('/image_raw', '/camera_info')):
        assert find_scan_topics(_bag(topics), {'image': image}).camera_info.name == info


def test_image_mono_is_found_where_there_is_no_image_raw():
    topics = {**SCAN, '/image_mono': IMAGE}
    assert find_scan_topics(_bag(topics)).image.name == '/image_raw'
    del topics['/image_raw']
    assert find_scan_topics(_bag(topics)).image.name == '/image_mono'


def test_topic_without_messages_is_no_candidate():
    topics = {**SCAN, '/image_raw/compressed': 'sensor_msgs/msg/CompressedImage'}
    roles = find_scan_topics(_bag(topics, empty=['/image_raw/compressed']))
    assert roles.image.name == '/image_raw'


def test_topics_that_the_user_chose_are_used():
    topics = {**SCAN, '/left/image_raw': SCAN['/image_raw'], '/odd': SCAN['/joint_states']}
    roles = find_scan_topics(_bag(topics), {'image': '/left/image_raw', 'laser_states': '/odd'})
    assert (roles.image.name, roles.laser_states.name) == ('/left/image_raw', '/odd')


@pytest.mark.parametrize('lacking', ['/image_raw', '/joint_states'])
def test_missing_topic_is_named_with_those_there_are(lacking):
    topics = {name: kind for name, kind in SCAN.items() if name != lacking}
    with pytest.raises(BagError, match=rf'no topic {lacking[1:]} \(.*it has /camera_info \('):
        find_scan_topics(_bag(topics))


@pytest.mark.parametrize(
    ('named', 'problem'),
    [
        ({'image': '/none'}, 'has no topic /none; it has /camera_info'),
        ({'image': '/joint_states'}, '/joint_states: is sensor_msgs/msg/JointState, as image'),
        ({'image': '/empty'}, '/empty: has no messages'),
        ({'picture': '/image_raw'}, "'picture' is not one of image, camera_info"),
    ],
)
def test_wrong_choice_is_named(named, problem):
    with pytest.raises(BagError, match=problem):
        find_scan_topics(_bag({**SCAN, '/empty': SCAN['/image_raw']}, empty=['/empty']), named)
