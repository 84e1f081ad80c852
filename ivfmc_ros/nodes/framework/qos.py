# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
QoS profiles of the topics of a cell: reliable, and transient local where late joiners need it.

Topics of foreign publishers are subscribed with the QoS they offer (``adaptive_subscription``).
"""

from rclpy.event_handler import PublisherEventCallbacks
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy
from rclpy.qos import HistoryPolicy
from rclpy.qos import QoSProfile
from rclpy.qos import ReliabilityPolicy

# Images queued while a subscriber is busy: 0.5 s at 60 images/s.
IMAGE_DEPTH = 30
# Profiles queued: more than 1 s at 60 profiles/s.
PROFILE_DEPTH = 100
# Views are published in one burst; no scan has more of them.
VIEW_DEPTH = 64
# States queued: 1 s of joint_states at 100 Hz.
STATE_DEPTH = 100

_DEPTHS = {
    'image_raw': IMAGE_DEPTH,
    'camera_info': IMAGE_DEPTH,
    'joint_states': STATE_DEPTH,
    'profile': PROFILE_DEPTH,
    'view': VIEW_DEPTH,
    'tf': STATE_DEPTH,
}
# Transient local: a late-joining subscription receives the last message.
_LATCHED = (
    'mesh',
    'mesh_shape',
    'cloud',
    'view_poses',
    'scan_status',
    'recorded',
    'laser_states',
    'robot_description',
    'tf_static',
)
_DEPTH = 10

# No QoS event handlers: each costs the executor time in every round, and incompatible offers are
# found in the ROS graph instead (``adaptive_subscription``).
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
    """Return a best-effort, volatile profile that keeps the last ``depth`` messages."""
    profile = reliable(depth)
    profile.reliability = ReliabilityPolicy.BEST_EFFORT
    return profile


def latched(depth: int = 1) -> QoSProfile:
    """Return a reliable, transient-local profile: late joiners get the last ``depth`` messages."""
    profile = reliable(depth)
    profile.durability = DurabilityPolicy.TRANSIENT_LOCAL
    return profile


def of_topic(name: str) -> QoSProfile:
    """Return the profile of a topic of this package, by the last part of its name."""
    last = name.rpartition('/')[2]
    if last == 'laser_states':
        # several changes within a few milliseconds, none of which may be lost
        return latched(STATE_DEPTH)
    return latched() if last in _LATCHED else reliable(_DEPTHS.get(last, _DEPTH))
