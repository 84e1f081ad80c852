# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How each topic is published: reliable, deep enough for a burst, latched where late comers ask.

What others publish is subscribed with what they offer (see ``adaptive``).
"""

from rclpy.event_handler import PublisherEventCallbacks
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy
from rclpy.qos import HistoryPolicy
from rclpy.qos import QoSProfile
from rclpy.qos import ReliabilityPolicy

# Pictures that may wait while a listener is busy: half a second at 60 a second.
IMAGE_DEPTH = 30
PROFILE_DEPTH = 100
VIEW_DEPTH = 64
STATE_DEPTH = 100

_DEPTHS = {
    'image_raw': IMAGE_DEPTH,
    'camera_info': IMAGE_DEPTH,
    'joint_states': STATE_DEPTH,
    'profile': PROFILE_DEPTH,
    'view': VIEW_DEPTH,
}
# A new listener gets the last message.
_LATCHED = (
    'mesh',
    'mesh_shape',
    'cloud',
    'view_poses',
    'scan_status',
    'recorded',
    'laser_states',
)
_DEPTH = 10

# Each event that somebody listens for costs the executor time in every round, and what they would
# tell (an offer that does not fit) is asked from the graph.
NO_PUBLISHER_EVENTS = PublisherEventCallbacks(use_default_callbacks=False)
NO_SUBSCRIPTION_EVENTS = SubscriptionEventCallbacks(use_default_callbacks=False)


def reliable(depth: int) -> QoSProfile:
    """Return a reliable, volatile profile that keeps the last ``depth`` messages."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.VOLATILE,
    )


def best_effort(depth: int) -> QoSProfile:
    """Return a best effort, volatile profile that keeps the last ``depth`` messages."""
    profile = reliable(depth)
    profile.reliability = ReliabilityPolicy.BEST_EFFORT
    return profile


def latched(depth: int = 1) -> QoSProfile:
    """Return a reliable profile whose last message a late listener gets."""
    profile = reliable(depth)
    profile.durability = DurabilityPolicy.TRANSIENT_LOCAL
    return profile


def of_topic(name: str) -> QoSProfile:
    """Return the profile that our nodes publish and subscribe a topic with, by its last name."""
    last = name.rpartition('/')[2]
    if last == 'laser_states':
        # changes follow each other closely, and none of them must be lost
        return latched(STATE_DEPTH)
    return latched() if last in _LATCHED else reliable(_DEPTHS.get(last, _DEPTH))
