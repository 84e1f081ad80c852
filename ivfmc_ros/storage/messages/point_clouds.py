# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Converts sensor_msgs/PointCloud2 messages to ``Profile`` and ``View``, without ROS.

Fields are found by name; any order, offset and numeric type is accepted.
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

FLOAT_FIELDS = ('x', 'y', 'z', 'intensity', 'sigma', 'u', 'v', 'angle', 'speed')
# Fields are aligned to their own size, so that a reader in C++ can map them. clamping is 0 in a
# single scan; the views of merged scans have different ones (View.clamping).
PROFILE_POINT_DTYPE = np.dtype(
    [
        *((name, '<f4') for name in FLOAT_FIELDS),
        ('seq', '<u4'),
        ('view', '<u2'),
        ('laser', 'u1'),
        ('clamping', 'u1'),
    ]
)
CLOUD_POINT_DTYPE = np.dtype(
    [
        *((name, '<f4') for name in FLOAT_FIELDS[:5]),
        ('view', '<u2'),
        ('laser', 'u1'),
        ('clamping', 'u1'),
    ]
)
# Recorded clouds of earlier versions lack these; they are read as 0.
OPTIONAL_FIELDS = ('speed', 'clamping')
REQUIRED_FIELDS = tuple(
    name for name in PROFILE_POINT_DTYPE.names or () if name not in OPTIONAL_FIELDS
)

# NumPy types by datatype of sensor_msgs/PointField.
POINT_FIELD_DTYPES = {
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
    Return the profile of a message, without its NaN points.

    where : file and topic, for the error
    :raises MessageError: a field is missing, or the size of the data does not fit the message
    """
    records = to_structured_array(message, where, REQUIRED_FIELDS).ravel()
    if not len(records):
        raise MessageError(f'{where}: has no point; a profile without points has one NaN point')
    first = records[0]
    valid = records[np.isfinite(records['x'])]
    return Profile(
        points_xyz=_columns(valid, 'x', 'y', 'z'),
        intensity=valid['intensity'].astype(np.float64),
        sigma=valid['sigma'].astype(np.float64),
        uv=_columns(valid, 'u', 'v'),
        angle=float(first['angle']),
        speed=float(_optional(first, 'speed')),
        laser=int(first['laser']),
        view=int(first['view']),
        seq=int(first['seq']),
        stamp_ns=cdr.stamp_ns(message),
    )


def to_view(message: Any, where: str) -> View:
    """
    Return the view of an organized point cloud: a row per stripe position, a column per profile.

    where : file and topic, for the error
    :raises MessageError: a field is missing, or the size of the data does not fit the message
    """
    records = to_structured_array(message, where, REQUIRED_FIELDS)
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
        clamping=int(_optional(records[0, 0], 'clamping')),
    )


def to_structured_array(message: Any, where: str, required: Sequence[str]) -> NDArray[Any]:
    """
    Return the points as a structured array, (height, width), without a copy.

    required : names of fields that the message must have
    :raises MessageError: the cloud is big-endian, a required field is missing or not a single
        number, or the data are shorter than the message says
    """
    if message.is_bigendian:
        raise MessageError(f'{where}: is big-endian; only little-endian clouds can be read')
    fields = {field.name: field for field in message.fields}
    missing = [name for name in required if name not in fields]
    if missing:
        existing = ', '.join(fields) or 'none'
        raise MessageError(f'{where}: field {missing[0]!r} is missing; fields there: {existing}')
    step = int(message.point_step)
    usable = {
        n: f for n, f in fields.items() if f.datatype in POINT_FIELD_DTYPES and f.count in (0, 1)
    }
    for name in required:
        if name not in usable:
            raise MessageError(f'{where}: field {name!r} is not a single number')
    formats = [np.dtype(POINT_FIELD_DTYPES[field.datatype]) for field in usable.values()]
    offsets = [int(field.offset) for field in usable.values()]
    ends = [offset + dtype.itemsize for offset, dtype in zip(offsets, formats, strict=True)]
    height, width, row = int(message.height), int(message.width), int(message.row_step)
    data = np.frombuffer(message.data, dtype=np.uint8)
    if max(ends, default=0) > step or row < width * step or data.size < height * row:
        raise MessageError(
            f'{where}: {data.size} bytes in rows of {row} are not {height} x {width} points of '
            f'{step} bytes'
        )
    dtype = np.dtype(
        {'names': list(usable), 'formats': formats, 'offsets': offsets, 'itemsize': step}
    )
    strides = (row, step)
    return np.ndarray((height, width), dtype=dtype, buffer=data, strides=strides)


def _columns(records: NDArray[Any], *names: str) -> Floats:
    return np.stack([records[name] for name in names], axis=-1).astype(np.float64)


def _optional(record: Any, name: str) -> float:
    """Return a field of one point, 0 where the message does not have it."""
    return record[name] if name in record.dtype.names else 0.0
