# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads the header of a profile (seq, view, laser, angle) from the first point of its message."""

from dataclasses import dataclass
import math
import struct
from typing import Any

import numpy as np

from ivfmc_ros.errors import MessageError
from ivfmc_ros.storage.messages import cdr

# struct formats by datatype of sensor_msgs/PointField: UINT8, UINT16, UINT32, FLOAT32.
_FORMATS = {2: 'B', 4: 'H', 6: 'I', 7: 'f'}
_FLOAT32 = 7
# Share of the points that ``reach`` holds: a stray one is not the part.
_WITHIN = 0.98


@dataclass(frozen=True, kw_only=True)
class ProfileHeader:
    """
    The values that are common to all points of a profile.

    seq : number of the profile in its scan, from 0
    laser : index in the order of the cell
    angle : table angle, radians; provisional in continuous motion
    points : number of points; the message of a profile without points has one NaN point
    stamp_ns : start of exposure, nanoseconds
    speed : velocity of the table, radians per second; 0 at standstill or where it is unknown
    reach : distance from the table axis, meters, within which 98 % of the points lie; 0 for none
    """

    seq: int
    view: int
    laser: int
    angle: float
    points: int
    stamp_ns: int
    speed: float = 0.0
    reach: float = 0.0


def read_profile_header(cloud: Any) -> ProfileHeader:
    """
    Read the header of a sensor_msgs/PointCloud2 on ``profile``.

    :raises MessageError: the message is not a profile
    """
    if cloud.is_bigendian:
        raise MessageError('profile: is big-endian, only little-endian clouds can be read')
    if cloud.width * cloud.height < 1 or len(cloud.data) < cloud.point_step:
        raise MessageError('profile: has no point; a profile without a stripe has one NaN point')
    fields = {field.name: field for field in cloud.fields}
    x = _value(cloud, fields, 'x')
    return ProfileHeader(
        seq=int(_value(cloud, fields, 'seq')),
        view=int(_value(cloud, fields, 'view')),
        laser=int(_value(cloud, fields, 'laser')),
        angle=float(_value(cloud, fields, 'angle')),
        speed=float(_value(cloud, fields, 'speed')) if 'speed' in fields else 0.0,
        points=cloud.width * cloud.height if not math.isnan(x) else 0,
        reach=_reach(cloud, fields),
        stamp_ns=cdr.stamp_ns(cloud),
    )


def _value(cloud: Any, fields: dict[str, Any], name: str) -> float:
    field = fields.get(name)
    if field is None or field.datatype not in _FORMATS:
        known = ', '.join(fields) or 'none'
        raise MessageError(f'profile: has no usable field {name!r}; its fields are {known}')
    kind = '<' + _FORMATS[field.datatype]
    try:
        return float(struct.unpack_from(kind, cloud.data, field.offset)[0])
    except struct.error as error:
        raise MessageError(f'profile: is too short for its field {name!r}') from error


def _reach(cloud: Any, fields: dict[str, Any]) -> float:
    x, y = fields['x'], fields.get('y')
    if y is None or (x.datatype, y.datatype) != (_FLOAT32, _FLOAT32):
        return 0.0
    if max(x.offset, y.offset) + 4 > cloud.point_step:
        raise MessageError(
            f'profile: fields x and y do not fit into points of {cloud.point_step} bytes'
        )
    layout = np.dtype(
        {
            'names': ['x', 'y'],
            'formats': ['<f4', '<f4'],
            'offsets': [x.offset, y.offset],
            'itemsize': cloud.point_step,
        }
    )
    count = min(cloud.width * cloud.height, len(cloud.data) // cloud.point_step)
    points = np.frombuffer(cloud.data, layout, count)
    distance = np.hypot(points['x'], points['y'])
    distance = distance[np.isfinite(distance)]
    if not len(distance):
        return 0.0
    last = int(_WITHIN * (len(distance) - 1))
    return float(np.partition(distance, last)[last])
