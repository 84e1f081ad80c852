# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recorders that are started for one test each."""

from sensor_msgs.msg import CompressedImage
from support.graph_rig import NodeProcess
from support.graph_rig import running

from ivfmc_ros.storage.bag.reader import open_bag


def test_bag_is_complete_when_the_node_ends(client, tmp_path):
    node = NodeProcess('recorder', scan_root=str(tmp_path.parent))
    client.set('recorder', scan_id='s1', scan_folder=str(tmp_path))
    assert client.trigger('recorder/start')[0]
    assert node.end() == 0, node.output
    assert open_bag(tmp_path).message_count == 0


def test_unknown_topic_is_refused_at_the_start():
    node = NodeProcess('recorder', topics=['elsewhere'])
    node.process.wait(timeout=20)
    assert node.end() == 2
    assert "'elsewhere' is not one of" in node.output


def test_compressed_pictures_are_recorded_when_asked_for(client, tmp_path):
    with running('recorder', scan_root=str(tmp_path), topics=['image_raw/compressed']):
        (tmp_path / 's1').mkdir()
        client.set('recorder', scan_id='s1', scan_folder=str(tmp_path / 's1'))
        images = client.publisher(CompressedImage, 'image_raw/compressed')
        client.trigger('recorder/start')
        client.until(images.get_subscription_count)
        images.publish(CompressedImage(format='jpeg', data=b'abc'))
        client.spin(0.3)
        client.trigger('recorder/stop')
        assert open_bag(tmp_path / 's1').topics['/ivfmc/image_raw/compressed'].count == 1
