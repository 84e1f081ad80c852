# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One sweep, reconstructed from a bag, fed bit by bit, and sent through the nodes."""

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2
from support.graph_rig import running
from support.sweep import sweep_events
from support.sweep import TrapezoidalMotion

from ivfmc_ros import pipeline
from ivfmc_ros.model import Frame
from ivfmc_ros.nodes.convert import clouds
from ivfmc_ros.nodes.processing import worker_jobs
from ivfmc_ros.storage.bag.writer import create_bag
from ivfmc_ros.storage.matching.frame_matching import FrameMatcher
from ivfmc_ros.storage.scans.scan_bag import open_scan
from ivfmc_ros.stripe.acquisition import Acquisition
from ivfmc_ros.stripe.acquisition import AcquisitionSettings
from ivfmc_ros.stripe.stream import StreamAcquisition

TURN = TrapezoidalMotion(speed=1.2, acceleration=4.0, begin=0.6, cruise=5.0)
LASERS = ('left', 'right')
SETTINGS = pipeline.Settings(registration='table', island_least=20)


@pytest.fixture(scope='module')
def events(cell, sphere):
    return sweep_events(cell, sphere, TURN, 15.0, 6.4)


@pytest.fixture(scope='module')
def offline(cell, events, tmp_path_factory):
    """The result of the offline pipeline for the bag."""
    folder = tmp_path_factory.mktemp('sweep') / 'bag'
    with create_bag(folder, compress=False) as bag:
        for stamp, kind, what in events:
            if kind == 'table':
                bag.joint_state(stamp, 'turntable_joint', what)
            elif kind == 'laser':
                bag.laser_state(stamp, {'left': what, 'right': False})
            else:
                bag.camera_info(stamp, cell.camera)
                bag.image(stamp, what)
    scan = open_scan(folder, lasers=LASERS)
    return pipeline.reconstruct(cell, scan.frames(), SETTINGS)


def same(view, expected):
    np.testing.assert_array_equal(view.seqs, expected.seqs)
    np.testing.assert_array_equal(view.valid, expected.valid)
    # points are sent as float32: half a step at 50 mm is 2 nm
    np.testing.assert_allclose(view.points_xyz, expected.points_xyz, rtol=0, atol=4e-9)


def test_ramps_of_the_sweep_are_dropped_and_its_motion_fitted(offline, sphere):
    (motion,) = offline.motions
    assert motion.speed == pytest.approx(TURN.speed, rel=5e-3)
    assert motion.dropped
    points = offline.views[0].cloud()
    # a constant delay turns the whole part, and the sphere with it
    turn = 0.0125 * TURN.speed
    c, s = np.cos(turn), np.sin(turn)
    turned = points @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    off = min((sphere.distance(at) for at in (points, turned)), key=lambda d: np.abs(d).mean())
    assert np.sqrt(np.mean(off**2)) < 1.5e-4


def test_functions_of_the_nodes_give_the_offline_views(cell, events, offline):
    matcher = FrameMatcher(LASERS)
    stream = StreamAcquisition(Acquisition(cell, AcquisitionSettings()))
    messages = []
    seq = 0

    def take(measured):
        messages.extend(clouds.from_profile(profile) for _, profile in measured)

    for number, (stamp, kind, what) in enumerate(events):
        now = 0.01 * number
        if kind == 'table':
            matcher.add_table_position(stamp, what, None, now)
        elif kind == 'laser':
            matcher.add_laser_states(stamp, {'left': float(what), 'right': 0.0}, now)
        else:
            matcher.add_image(stamp, what, now)
        for match in matcher.pop_matches(now, 30.0):
            if not match.reason:
                take(stream.add(frame_of(match, seq)))
                seq += 1
    profiles = [clouds.to_profile(message, 'profile') for message in messages]
    made = worker_jobs.register(cell, profiles, SETTINGS)
    (view,), (expected,) = made.views, offline.views
    same(clouds.to_view(clouds.from_view(view, 0), 'view'), expected)
    assert made.counts['kept_points'] == offline.counts['kept_points']
    assert made.motions == offline.motions


def frame_of(match, seq):
    return Frame(
        image=match.payload,
        stamp_ns=match.stamp_ns,
        angle=match.angle,
        laser=match.laser,
        view=match.view,
        seq=seq,
        speed=match.speed,
    )


def test_nodes_give_the_offline_views(client, inputs, cell_file, events, offline):
    profiles = client.collect(PointCloud2, 'profile')
    found = client.collect(PointCloud2, 'view')
    cell = {'cell': str(cell_file)}
    with (
        running('triangulator', **cell),
        running('registrar', **cell, registration='table', island_least=20),
    ):
        inputs.wait()
        # of the triangulator and not of the graph, which knows of a subscription before that
        client.until(lambda: 'profile_subscriptions: 2' in client.diagnostic('triangulator'))
        client.until(lambda: inputs.info.get_subscription_count() == 2)
        inputs.camera_info()
        client.until(lambda: 'camera_info' not in client.diagnostic('registrar'))
        pictures = 0
        for stamp, kind, what in events:
            if kind == 'table':
                inputs.table(what, stamp, velocity=float('nan'))
            elif kind == 'laser':
                inputs.lit(0 if what else -1, stamp)
            else:
                inputs.picture(what, stamp)
                pictures += 1
                # no faster than the nodes receive
                client.spin(0.03)
        wanted = offline.counts['pictures']
        client.until(lambda: len(profiles) == wanted)
        client.until(lambda: f'profiles: {wanted}' in client.diagnostic('registrar'))
        good, answer = client.trigger('registrar/register')
        assert good, answer
        client.until(lambda: found)
    same(clouds.to_view(found[0], 'view'), offline.views[0])
    assert answer['counts']['kept_points'] == offline.counts['kept_points']
