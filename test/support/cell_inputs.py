# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Publishers of camera, table and laser messages, for tests of their subscribers."""

from sensor_msgs.msg import CameraInfo
from sensor_msgs.msg import Image
from sensor_msgs.msg import JointState

from ivfmc_ros.nodes.convert import images
from ivfmc_ros.nodes.convert.stamps import header

START = 1_790_000_000_000_000_000
STEP = 100_000_000


class Inputs:
    """Publishes the topics of a camera, a table and two lasers."""

    def __init__(self, client, cell):
        self.client, self.cell = client, cell
        self.image = client.publisher(Image, 'image_raw')
        self.info = client.publisher(CameraInfo, 'camera_info')
        self.joints = client.publisher(JointState, 'joint_states')
        self.lasers = client.publisher(JointState, 'laser_states')
        self.topics = (self.image, self.info, self.joints, self.lasers)

    def heard(self):
        return all(topic.get_subscription_count() for topic in self.topics)

    def wait(self):
        self.client.until(self.heard, what='no subscription')
        # an adaptive subscription may be created again
        self.client.spin(0.6)

    def picture(self, image, stamp_ns):
        self.image.publish(images.to_image(image, stamp_ns))

    def camera_info(self, stamp_ns=START, **changes):
        camera = self.cell.camera
        message = CameraInfo(
            header=header(stamp_ns, 'camera_optical_frame'),
            width=changes.get('width', camera.width),
            height=changes.get('height', camera.height),
            distortion_model='plumb_bob',
            d=camera.distortion.tolist(),
            k=changes.get('k', camera.K.ravel().tolist()),
        )
        self.info.publish(message)

    def table(self, angle, stamp_ns, name='turntable_joint', velocity=0.0):
        self.joints.publish(
            JointState(
                header=header(stamp_ns, ''),
                name=[name],
                position=[float(angle)],
                velocity=[float(velocity)],
            )
        )

    def lit(self, laser, stamp_ns):
        names = [known.name for known in self.cell.lasers]
        states = [float(index == laser) for index in range(len(names))]
        self.lasers.publish(JointState(header=header(stamp_ns, ''), name=names, position=states))

    def step(self, number, frame, angle=None):
        """Publish all messages of one image of a scan in step motion."""
        stamp = START + number * STEP
        angle = frame.angle if angle is None else angle
        self.camera_info(stamp)
        self.lit(frame.laser, stamp - STEP // 4)
        self.table(angle, stamp)
        self.picture(frame.image, stamp)
        self.lit(frame.laser, stamp + STEP // 4)
        self.client.spin(0.0)
