# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Triangle meshes to serialized visualization_msgs/Marker and shape_msgs/Mesh, and from the latter.

200,000 triangles take 2.5 s through message objects and 0.08 s here: rclpy serializes the message
without points, and the arrays are inserted at their offset. CDR is little endian and aligns
eight-byte numbers to eight bytes, counted from behind its four-byte header.
"""

from geometry_msgs.msg import Pose
from geometry_msgs.msg import Quaternion
from geometry_msgs.msg import Vector3
import numpy as np
from rclpy.serialization import serialize_message
from shape_msgs.msg import Mesh as MeshMessage
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker

from ivfmc_ros.errors import MessageError
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.nodes.convert.clouds import FRAME
from ivfmc_ros.nodes.convert.stamps import header

_CDR_HEADER = 4
_GREY = (0.72, 0.74, 0.78)


def marker(vertices_xyz: Floats, faces: Ints, stamp_ns: int) -> bytes:
    """
    Return a visualization_msgs/Marker (TRIANGLE_LIST) as CDR.

    vertices_xyz, faces : (n, 3) meters, (m, 3) vertex indices
    """
    empty = Marker(
        header=header(stamp_ns, FRAME),
        ns='mesh',
        type=Marker.TRIANGLE_LIST,
        pose=Pose(orientation=Quaternion(w=1.0)),
        scale=Vector3(x=1.0, y=1.0, z=1.0),
        color=ColorRGBA(r=_GREY[0], g=_GREY[1], b=_GREY[2], a=1.0),
    )
    bare = bytes(serialize_message(empty))
    start = _start_of_points(empty)
    corners = np.ascontiguousarray(vertices_xyz[faces.ravel()], dtype='<f8')
    return bare[:start] + _doubles(start, corners) + bare[start + 4 :]


def mesh_shape(vertices_xyz: Floats, faces: Ints) -> bytes:
    """Return a shape_msgs/Mesh as CDR: (n, 3) vertices in meters, (m, 3) vertex indices."""
    start = bytes(serialize_message(MeshMessage()))[:_CDR_HEADER]
    triangles = np.ascontiguousarray(faces, dtype='<u4')
    head = start + _count(len(triangles)) + triangles.tobytes()
    return head + _doubles(len(head), np.ascontiguousarray(vertices_xyz, dtype='<f8'))


def from_mesh_shape(data: bytes) -> tuple[Floats, Ints]:
    """
    Return the vertices (n, 3) in meters and faces (m, 3) of a shape_msgs/Mesh in CDR.

    :raises MessageError: it is cut short, big endian, or a face names a vertex that it lacks
    """
    try:
        if data[1:2] != b'\x01':
            raise MessageError('mesh_shape: is not little endian')
        count = int.from_bytes(data[_CDR_HEADER : _CDR_HEADER + 4], 'little')
        start = _CDR_HEADER + 4
        faces = np.frombuffer(data, '<u4', 3 * count, start).reshape(-1, 3).astype(np.int64)
        start += 12 * count
        number = int.from_bytes(data[start : start + 4], 'little')
        start = _CDR_HEADER + _aligned(start + 4 - _CDR_HEADER, 8)
        vertices = np.frombuffer(data, '<f8', 3 * number, start if number else 0).reshape(-1, 3)
    except ValueError as error:
        raise MessageError(f'mesh_shape: is cut short: {error}') from error
    if len(faces) and faces.max() >= number:
        raise MessageError('mesh_shape: a face names a vertex that it lacks')
    return vertices.astype(np.float64), faces


def _doubles(position: int, values: Floats) -> bytes:
    """Return an (n, 3) array as the CDR sequence that starts at byte ``position``."""
    after = position + 4 - _CDR_HEADER
    padding = -after % 8 if len(values) else 0
    return _count(len(values)) + bytes(padding) + values.tobytes()


def _count(number: int) -> bytes:
    return int(number).to_bytes(4, 'little')


def _start_of_points(empty: Marker) -> int:
    """Return the byte offset of the number of points in a serialized marker."""
    position = 8
    for text in (empty.header.frame_id, empty.ns):
        position = _aligned(position, 4) + 4 + len(text.encode()) + 1
    # id, type and action; pose and scale; color, lifetime and frame_locked
    position = _aligned(position, 4) + 12
    position = _aligned(position, 8) + 56 + 24 + 16 + 8 + 1
    return _CDR_HEADER + _aligned(position, 4)


def _aligned(position: int, size: int) -> int:
    return position + -position % size
