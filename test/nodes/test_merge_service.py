# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Merging of stored scans by registrar/merge, and meshing of the result by mesher/build."""

from geometry_msgs.msg import PoseArray
import numpy as np
import open3d as o3d
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2
from support.clampings import displacement
from support.clampings import lying
from support.erring_table import profiles_of
from support.erring_table import stripes
from support.erring_table import turns
from support.graph_rig import running

from ivfmc_ros import pipeline
from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.camera_file import save_camera
from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.nodes.convert import clouds
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.solids import demo_part
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.messages.profile_header import ProfileHeader
from ivfmc_ros.storage.recording.live_recorder import LiveRecorder
from ivfmc_ros.storage.scans.stored_scan import load_profiles

# meters; the platter is at z = 0, and the first clamping holds the flange below it
LOWERED = -0.012
PLACES = {
    'up': transforms.rigid(np.eye(3), (0.0, 0.0, LOWERED)),
    'down': lying(demo_part(), 0),
}


def store(catalogue, root, scan_id, cell, place, steps=80):
    """Record the profiles of a scan of the demo part as the recorder does."""
    catalogue.add_scan(scan_id, 'flange', '', 'DONE', {})
    folder = root / scan_id
    folder.mkdir()
    save_cell(folder / 'cell.yaml', cell)
    save_camera(folder / 'camera.yaml', cell.camera)
    sweeps = turns(steps, np.zeros_like)
    measured = stripes(cell, demo_part().moved(place), sweeps, 1)
    recorder = LiveRecorder(
        folder, on_flush=lambda places: catalogue.add_profiles(scan_id, places)
    )
    for profile in profiles_of(cell, measured, sweeps):
        message = serialize_message(clouds.from_profile(profile))
        mark = ProfileHeader(
            seq=profile.seq,
            view=profile.view,
            laser=profile.laser,
            angle=profile.angle,
            points=len(profile),
            stamp_ns=profile.stamp_ns,
        )
        kind = 'sensor_msgs/msg/PointCloud2'
        recorder.add('/ivfmc/profile', kind, message, 1 + profile.stamp_ns, header=mark)
    recorder.stop()


@pytest.fixture(scope='module')
def root(tmp_path_factory):
    folder = tmp_path_factory.mktemp('scans')
    catalogue = Catalogue(folder, create=True)
    for scan_id, place in PLACES.items():
        store(catalogue, folder, scan_id, bench_cell(), place)
    return folder


@pytest.mark.slow
def test_stored_scans_are_merged_published_and_meshed_as_offline(client, root, tmp_path):
    views = client.collect(PointCloud2, 'view')
    poses = client.collect(PoseArray, 'view_poses')
    files = {'cell': str(root / 'up' / 'cell.yaml'), 'camera': str(root / 'up' / 'camera.yaml')}
    folders = {'scan_root': str(tmp_path.parent), 'scan_folder': str(tmp_path)}
    with (
        running('registrar', scan_root=str(root), merge=['up', 'down']),
        running('mesher', **files, **folders, formats=['ply']),
    ):
        client.until(lambda: client.node.count_publishers('view') == 1)
        client.until(lambda: client.node.count_subscribers('view_poses') == 2)
        good, answer = client.trigger('registrar/merge', seconds=300.0)
        assert good, answer
        client.until(lambda: len(views) == 4 and poses)
        good, built = client.trigger('mesher/build', seconds=300.0)
        assert good, built
    assert [scan['name'] for scan in answer['scans']] == ['up', 'down']
    found = np.array(answer['scans'][1]['first_from_scan']) @ PLACES['down']
    assert displacement(demo_part(), found, PLACES['up']) < 1e-4
    assert [view['view'] for view in answer['views']] == [0, 1, 2, 3]
    assert len(poses[0].poses) == 4
    assert {view.header.stamp.nanosec for view in views} == {poses[0].header.stamp.nanosec}
    # the flange, which is below the platter, is in the mesh: as offline
    offline = offline_mesh(root).vertices_xyz
    vertices = 1e-3 * np.asarray(o3d.io.read_triangle_mesh(str(tmp_path / 'mesh.ply')).vertices)
    assert offline[:, 2].min() < LOWERED + 1e-3
    assert vertices[:, 2].min() == pytest.approx(offline[:, 2].min(), abs=2e-4)
    # points are rounded to single precision in messages, and the triangles with them
    below = np.count_nonzero(vertices[:, 2] < 0.0)
    assert below == pytest.approx(np.count_nonzero(offline[:, 2] < 0.0), rel=0.01)


def offline_mesh(root):
    """Merge the stored scans and mesh them without nodes, as ``ivfmc merge`` does."""
    settings = pipeline.Settings()
    clampings = []
    for scan_id in PLACES:
        profiles, cell = load_profiles(root, scan_id)
        clampings.append(pipeline.register_clamping(scan_id, cell, profiles, settings))
    return pipeline.reconstruct_clampings(clampings, settings).mesh


def test_scans_that_cannot_be_merged_are_rejected_with_a_code(client, root):
    with running('registrar', scan_root=str(root)):
        good, answer = client.trigger('registrar/merge')
        assert (good, answer['code']) == (False, 'BAD_PARAMETER')
        assert 'two or more scans are needed' in answer['detail']
        assert client.set('registrar', merge=['up', 'sideways']).successful
        good, answer = client.trigger('registrar/merge')
        assert (good, answer['code']) == (False, 'BAD_CATALOGUE')
        assert 'sideways' in answer['detail']
