# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Profiles and views out of sensor_msgs/PointCloud2, live or from a bag. No ROS.

Fields are read by their names and offsets, in whatever order and number type they come.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ivfmc_ros.errors import MessageError
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Profile
from ivfmc_ros.model import View
from ivfmc_ros.storage.messages import cdr

NAMES = ('x', 'y', 'z', 'intensity', 'sigma', 'u', 'v', 'angle', 'speed')
# aligned to their own size, so that a reader in C++ can map them
POINT = np.dtype([*((name, '<f4') for name in NAMES), ('seq', '<u4'), ('view', '<u2'),
                  ('laser', 'u1'), ('padding', 'u1')])  # fmt: skip
CLOUD_POINT = np.dtype([*((name, '<f4') for name in NAMES[:5]), ('view', '<u2'),
                        ('laser', 'u1'), ('padding', 'u1')])  # fmt: skip
REQUIRED = tuple(name for name in POINT.names or () if name not in ('padding', 'speed'))

# what sensor_msgs/PointField calls its datatypes
TYPES = {
    1: 'i1',
    2: 'u1',
    3: '<i2',
    4: '<u2',
    5: '<i4',
    6: '<u4',
    7: '<f4',
    8: '<f8',
}


def to_profile(message: Any, where: str) -> Profile:
    """
    Return the profile of a message; points that are NaN are left out.

    where : the topic, for the error
    :raises MessageError: a field is missing, or the data are not what the message says
    """
    records = records_of(message, where, REQUIRED).ravel()
    if not len(records):
        raise MessageError(f'{where}: has no point; a profile without any is one NaN point')
    first = records[0]
    speed = float(first['speed']) if 'speed' in (records.dtype.names or ()) else 0.0
    valid = records[np.isfinite(records['x'])]
    return Profile(
        points_xyz=_columns(valid, 'x', 'y', 'z'),
        intensity=valid['intensity'].astype(np.float64),
        sigma=valid['sigma'].astype(np.float64),
        uv=_columns(valid, 'u', 'v'),
        angle=float(first['angle']),
        speed=speed,
        laser=int(first['laser']),
        view=int(first['view']),
        seq=int(first['seq']),
        stamp_ns=cdr.stamp_ns(message),
    )


def to_view(message: Any, where: str) -> View:
    """
    Return the view of an organised cloud.

    where : the topic, for the error
    :raises MessageError: a field is missing, or the data are not what the message says
    """
    records = records_of(message, where, REQUIRED)
    if not records.size:
        raise MessageError(f'{where}: has no point')
    return View(
        number=int(records['view'][0, 0]),
        laser=int(records['laser'][0, 0]),
        points_xyz=_columns(records, 'x', 'y', 'z'),
        intensity=records['intensity'].astype(np.float64),
        sigma=records['sigma'].astype(np.float64),
        uv=_columns(records, 'u', 'v'),
        angles=records['angle'][0].astype(np.float64),
        seqs=records['seq'][0].astype(np.int64),
    )


def records_of(message: Any, where: str, required: Sequence[str]) -> NDArray[Any]:
    """
    Return the points as a structured array, (height, width), without a copy.

    :raises MessageError: big-endian, a required field is missing or no single number, or the
        data are shorter than the message says
    """
    if message.is_bigendian:
        raise MessageError(f'{where}: is big-endian; only little-endian clouds are understood')
    fields = {field.name: field for field in message.fields}
    missing = [name for name in required if name not in fields]
    if missing:
        there = ', '.join(fields) or 'none'
        raise MessageError(f'{where}: field {missing[0]!r} is missing; fields there: {there}')
    step = int(message.point_step)
    usable = {n: f for n, f in fields.items() if f.datatype in TYPES and f.count in (0, 1)}
    for name in required:
        if name not in usable:
            raise MessageError(f'{where}: field {name!r} is not one number')
    formats = [np.dtype(TYPES[field.datatype]) for field in usable.values()]
    offsets = [int(field.offset) for field in usable.values()]
    ends = [offset + kind.itemsize for offset, kind in zip(offsets, formats, strict=True)]
    height, width, row = int(message.height), int(message.width), int(message.row_step)
    data = np.frombuffer(message.data, dtype=np.uint8)
    if max(ends, default=0) > step or row < width * step or data.size < height * row:
        raise MessageError(
            f'{where}: {data.size} bytes in rows of {row} are no {height} x {width} points of '
            f'{step} bytes'
        )
    kind = np.dtype(
        {'names': list(usable), 'formats': formats, 'offsets': offsets, 'itemsize': step}
    )
    strides = (row, step)
    return np.ndarray((height, width), dtype=kind, buffer=data, strides=strides)


def _columns(records: NDArray[Any], *names: str) -> Floats:
    return np.stack([records[name] for name in names], axis=-1).astype(np.float64)
