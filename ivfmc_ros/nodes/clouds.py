# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Profiles, views and clouds as sensor_msgs/PointCloud2 and back.

Fields are read by their names and offsets, in whatever order and number type they come.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2
from sensor_msgs.msg import PointField

from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import MessageError
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Poses
from ivfmc_ros.model import Profile
from ivfmc_ros.model import View
from ivfmc_ros.nodes.images import octets
from ivfmc_ros.nodes.stamps import header
from ivfmc_ros.nodes.stamps import nanoseconds

FRAME = 'turntable'

_NAMES = ('x', 'y', 'z', 'intensity', 'sigma', 'u', 'v', 'angle', 'speed')
# aligned to their own size, so that a reader in C++ can map them
POINT = np.dtype([*((name, '<f4') for name in _NAMES), ('seq', '<u4'), ('view', '<u2'),
                  ('laser', 'u1'), ('padding', 'u1')])  # fmt: skip
CLOUD_POINT = np.dtype([*((name, '<f4') for name in _NAMES[:5]), ('view', '<u2'),
                        ('laser', 'u1'), ('padding', 'u1')])  # fmt: skip
REQUIRED = tuple(name for name in POINT.names or () if name not in ('padding', 'speed'))

_TYPES = {
    PointField.INT8: 'i1',
    PointField.UINT8: 'u1',
    PointField.INT16: '<i2',
    PointField.UINT16: '<u2',
    PointField.INT32: '<i4',
    PointField.UINT32: '<u4',
    PointField.FLOAT32: '<f4',
    PointField.FLOAT64: '<f8',
}
_CODES = {np.dtype(name): code for code, name in _TYPES.items()}


def from_profile(profile: Profile) -> PointCloud2:
    """Return a profile as one row of points; one NaN point where it has none."""
    records = np.zeros((1, max(len(profile), 1)), dtype=POINT)
    _fill(records[0], profile.points_xyz, profile.intensity, profile.sigma, profile.uv)
    records['angle'], records['speed'] = profile.angle, profile.speed
    records['seq'], records['view'], records['laser'] = profile.seq, profile.view, profile.laser
    return _message(records, profile.stamp_ns)


def to_profile(message: PointCloud2, where: str) -> Profile:
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
        stamp_ns=nanoseconds(message.header.stamp),
    )


def from_view(view: View, stamp_ns: int) -> PointCloud2:
    """Return a view as an organised cloud: a column for each profile, a row for each row."""
    records = np.zeros(view.intensity.shape, dtype=POINT)
    _fill(records, view.points_xyz, view.intensity, view.sigma, view.uv)
    records['angle'], records['seq'] = view.angles, view.seqs
    records['view'], records['laser'] = view.number, view.laser
    return _message(records, stamp_ns)


def to_view(message: PointCloud2, where: str) -> View:
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


def from_views(views: Sequence[View], poses: Poses, stamp_ns: int) -> PointCloud2:
    """Return the points of all views at their places, as one row."""
    parts = []
    for view, T in zip(views, poses.turntable_from_view, strict=True):
        valid = view.valid
        records = np.zeros(int(np.count_nonzero(valid)), dtype=CLOUD_POINT)
        points = transforms.apply(T, view.points_xyz[valid])
        records['x'], records['y'], records['z'] = points.T
        records['intensity'], records['sigma'] = view.intensity[valid], view.sigma[valid]
        records['view'], records['laser'] = view.number, view.laser
        parts.append(records)
    whole = np.concatenate(parts) if parts else np.zeros(0, dtype=CLOUD_POINT)
    return _message(whole[None], stamp_ns)


def records_of(message: PointCloud2, where: str, required: Sequence[str]) -> NDArray[Any]:
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
    usable = {n: f for n, f in fields.items() if f.datatype in _TYPES and f.count in (0, 1)}
    for name in required:
        if name not in usable:
            raise MessageError(f'{where}: field {name!r} is not one number')
    formats = [np.dtype(_TYPES[field.datatype]) for field in usable.values()]
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


def _fill(
    records: NDArray[Any], points: Floats, intensity: Floats, sigma: Floats, uv: Floats
) -> None:
    """Write what each point has of its own; NaN where there is no point at all."""
    for name in _NAMES[:7]:
        records[name] = np.nan
    count = records.size if intensity.size else 0
    if not count:
        return
    records['x'], records['y'], records['z'] = np.moveaxis(points, -1, 0)
    records['intensity'], records['sigma'] = intensity, sigma
    records['u'], records['v'] = np.moveaxis(uv, -1, 0)


def _columns(records: NDArray[Any], *names: str) -> Floats:
    return np.stack([records[name] for name in names], axis=-1).astype(np.float64)


def _message(records: NDArray[Any], stamp_ns: int) -> PointCloud2:
    kind = records.dtype
    height, width = records.shape
    fields = [
        PointField(name=name, offset=kind.fields[name][1], datatype=_CODES[kind[name]], count=1)
        for name in kind.names or ()
        if name != 'padding' and kind.fields is not None
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
