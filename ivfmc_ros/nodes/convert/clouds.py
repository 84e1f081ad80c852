# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Profiles, views and registered clouds to sensor_msgs/PointCloud2.

The other direction, which needs no ROS, is in ``storage.messages.point_clouds``.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2
from sensor_msgs.msg import PointField

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Poses
from ivfmc_ros.model import Profile
from ivfmc_ros.model import View
from ivfmc_ros.nodes.convert.images import octets
from ivfmc_ros.nodes.convert.stamps import header
from ivfmc_ros.storage.messages.point_clouds import CLOUD_POINT_DTYPE
from ivfmc_ros.storage.messages.point_clouds import FLOAT_FIELDS
from ivfmc_ros.storage.messages.point_clouds import POINT_FIELD_DTYPES
from ivfmc_ros.storage.messages.point_clouds import PROFILE_POINT_DTYPE
from ivfmc_ros.storage.messages.point_clouds import REQUIRED_FIELDS
from ivfmc_ros.storage.messages.point_clouds import to_profile
from ivfmc_ros.storage.messages.point_clouds import to_structured_array
from ivfmc_ros.storage.messages.point_clouds import to_view

__all__ = [
    'CLOUD_POINT_DTYPE',
    'PROFILE_POINT_DTYPE',
    'REQUIRED_FIELDS',
    'from_profile',
    'from_view',
    'from_views',
    'to_profile',
    'to_structured_array',
    'to_view',
]

FRAME = 'turntable'

_CODES = {np.dtype(name): code for code, name in POINT_FIELD_DTYPES.items()}


def from_profile(profile: Profile) -> PointCloud2:
    """Return a profile as one row of points; a profile without points becomes one NaN point."""
    records = np.zeros((1, max(len(profile), 1)), dtype=PROFILE_POINT_DTYPE)
    _fill(records[0], profile.points_xyz, profile.intensity, profile.sigma, profile.uv)
    records['angle'], records['speed'] = profile.angle, profile.speed
    records['seq'], records['view'], records['laser'] = profile.seq, profile.view, profile.laser
    return _message(records, profile.stamp_ns)


def from_view(view: View, stamp_ns: int) -> PointCloud2:
    """Return a view as an organized cloud: one column per profile, one row per stripe row."""
    records = np.zeros(view.intensity.shape, dtype=PROFILE_POINT_DTYPE)
    _fill(records, view.points_xyz, view.intensity, view.sigma, view.uv)
    records['angle'], records['seq'] = view.angles, view.seqs
    records['view'], records['laser'] = view.number, view.laser
    records['clamping'] = view.clamping
    return _message(records, stamp_ns)


def from_views(views: Sequence[View], poses: Poses, stamp_ns: int) -> PointCloud2:
    """Return the points of all views, transformed by their poses, as one row."""
    parts = []
    for view, T in zip(views, poses.turntable_from_view, strict=True):
        valid = view.valid
        records = np.zeros(int(np.count_nonzero(valid)), dtype=CLOUD_POINT_DTYPE)
        points = transforms.apply(T, view.points_xyz[valid])
        records['x'], records['y'], records['z'] = points.T
        records['intensity'], records['sigma'] = view.intensity[valid], view.sigma[valid]
        records['view'], records['laser'] = view.number, view.laser
        records['clamping'] = view.clamping
        parts.append(records)
    whole = np.concatenate(parts) if parts else np.zeros(0, dtype=CLOUD_POINT_DTYPE)
    return _message(whole[None], stamp_ns)


def _fill(
    records: NDArray[Any], points: Floats, intensity: Floats, sigma: Floats, uv: Floats
) -> None:
    """Write the fields that differ from point to point; NaN for a profile without points."""
    for name in FLOAT_FIELDS[:7]:
        records[name] = np.nan
    count = records.size if intensity.size else 0
    if not count:
        return
    records['x'], records['y'], records['z'] = np.moveaxis(points, -1, 0)
    records['intensity'], records['sigma'] = intensity, sigma
    records['u'], records['v'] = np.moveaxis(uv, -1, 0)


def _message(records: NDArray[Any], stamp_ns: int) -> PointCloud2:
    kind = records.dtype
    height, width = records.shape
    fields = [
        PointField(name=name, offset=kind.fields[name][1], datatype=_CODES[kind[name]], count=1)
        for name in kind.names or ()
        if kind.fields is not None
    ]
    return PointCloud2(
        header=header(stamp_ns, FRAME),
        height=height,
        width=width,
        fields=fields,
        is_bigendian=False,
        point_step=kind.itemsize,
        row_step=kind.itemsize * width,
        data=octets(np.ascontiguousarray(records).view(np.uint8)),
        is_dense=bool(np.isfinite(records['x']).all()),
    )
