# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Serializes ROS 2 messages to CDR and back, without ROS.

Messages are written by the definitions of ROS 2 Jazzy and read by the definitions in the bag.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
import struct
from typing import Any
from typing import Literal

from rosbags.serde import SerdeError
from rosbags.typesys import get_types_from_idl
from rosbags.typesys import get_types_from_msg
from rosbags.typesys import get_typestore
from rosbags.typesys import Stores
from rosbags.typesys import TypesysError

from ivfmc_ros.errors import BagError

ENCODING = 'cdr'

TIME = 'builtin_interfaces/msg/Time'
HEADER = 'std_msgs/msg/Header'

NANOSECONDS = 1_000_000_000

# Exceptions of rosbags, older versions included, for bytes that do not fit the definition.
_DECODING_ERRORS = (SerdeError, struct.error, ValueError, KeyError, IndexError, AssertionError)

# Size of the CDR encapsulation header (4 bytes) and a stamp (8 bytes).
_STAMP_END = 12

_SEPARATOR = '=' * 80
_EVENT_SUFFIX = '_Event'
_EVENT = """service_msgs/ServiceEventInfo info
{name}_Request[<=1] request
{name}_Response[<=1] response
"""
# Types whose fields this package reads.
_READ_TYPES = frozenset(
    f'sensor_msgs/msg/{name}'
    for name in ('CameraInfo', 'CompressedImage', 'Image', 'JointState', 'PointCloud2')
)


@cache
def _jazzy() -> Any:
    return get_typestore(Stores.ROS2_JAZZY)


def full_name(name: str) -> str:
    """Return a type name as package/msg/Type; accepts 'sensor_msgs/Image' and service events."""
    package, _, rest = name.partition('/')
    return f'{package}/msg/{rest.rpartition("/")[2]}'


def knows(msgtype: str) -> bool:
    """Tell whether a type such as 'sensor_msgs/msg/Image' is in ROS 2 Jazzy."""
    return msgtype in _jazzy().fielddefs


@cache
def definition(msgtype: str) -> str:
    """Return a message definition, with those of its fields' types, in ros2msg format."""
    text, _ = _jazzy().generate_msgdef(msgtype, ros_version=2)
    return str(text)


@cache
def type_hash(msgtype: str) -> str:
    """Return the RIHS01 hash of a message definition (REP 2011)."""
    return str(_jazzy().hash_rihs01(msgtype))


def message(msgtype: str, **fields: Any) -> Any:
    """Return a message; all fields are needed, numeric arrays as NumPy arrays of their dtype."""
    return _jazzy().types[msgtype](**fields)


def header(stamp_ns: int, frame_id: str) -> Any:
    """Return a std_msgs/Header."""
    seconds, nanoseconds = divmod(stamp_ns, NANOSECONDS)
    stamp = message(TIME, sec=seconds, nanosec=nanoseconds)
    return message(HEADER, stamp=stamp, frame_id=frame_id)


def stamp_ns(message: Any) -> int:
    """Return the stamp of a message's header in nanoseconds."""
    stamp = message.header.stamp
    return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)


def restamped(message: Any, stamp_ns: int) -> Any:
    """Return a message, which begins with a header, with another stamp in nanoseconds."""
    seconds, nanoseconds = divmod(stamp_ns, NANOSECONDS)
    stamp = replace(message.header.stamp, sec=seconds, nanosec=nanoseconds)
    return replace(message, header=replace(message.header, stamp=stamp))


def leading_stamp_ns(data: bytes | memoryview) -> int:
    """
    Return the stamp, nanoseconds, of an encoded message that begins with a header.

    :raises BagError: the message is too short
    """
    if len(data) < _STAMP_END:
        raise BagError(f'{len(data)} bytes have no header')
    order: Literal['little', 'big'] = 'little' if data[1] & 1 else 'big'
    seconds = int.from_bytes(data[4:8], order, signed=True)
    return seconds * NANOSECONDS + int.from_bytes(data[8:12], order)


def encode(message: Any) -> bytes:
    """Return a message as CDR, little endian."""
    return bytes(_jazzy().serialize_cdr(message, message.__msgtype__, little_endian=True))


def decoder(name: str, encoding: str, text: str) -> Callable[[bytes | memoryview], Any]:
    """
    Return a function that decodes CDR of either byte order by a definition.

    Arrays of a decoded message are views of the bytes.

    name : type, such as 'sensor_msgs/msg/Image'
    encoding, text : 'ros2msg' or 'ros2idl', and the definition in that format
    :returns: function; raises BagError for bytes that do not fit the definition
    :raises BagError: the definition cannot be parsed, or lacks a field that this package reads
    """
    store = get_typestore(Stores.EMPTY)
    name = full_name(name)
    try:
        types = _parse(name, encoding, text)
        store.register(types)
        store.get_msgdef(name)
        _require_fields(name, [field for field, _ in store.fielddefs[name][1]])
    except (TypesysError, *_DECODING_ERRORS) as error:
        raise BagError(f'the definition of {name} cannot be parsed: {error}') from error

    def decode(data: bytes | memoryview) -> Any:
        try:
            # rosbags copies bytes, not a view of them
            return store.deserialize_cdr(memoryview(data), name)
        except _DECODING_ERRORS as error:
            raise BagError(f'{len(data)} bytes are not a {name}: {error}') from error

    return decode


def _require_fields(name: str, fields: list[str]) -> None:
    # types that are only passed on may be of another release of ROS
    needed = [field for field, _ in _jazzy().fielddefs[name][1]] if name in _READ_TYPES else []
    missing = [field for field in needed if field not in fields]
    if missing:
        raise ValueError(f'it has no field {missing[0]!r}; its fields are {", ".join(fields)}')


def _parse(name: str, encoding: str, text: str) -> dict[str, Any]:
    if encoding == 'ros2idl':
        return _parse_idl(text)
    if encoding != 'ros2msg':
        raise ValueError(f'its encoding is {encoding!r}, known are ros2msg and ros2idl')
    if name.endswith(_EVENT_SUFFIX) and '\n---\n' in text:
        text = _event_definition(name, text)
    types = dict(get_types_from_msg(text, name))
    return {**_builtins(), **types}


def _parse_idl(text: str) -> dict[str, Any]:
    types = {}
    for part in text.split(f'{_SEPARATOR}\n'):
        # each definition follows a line 'IDL: <type>'
        body = part.partition('\n')[2] if part.startswith('IDL: ') else part
        if body.strip():
            types.update(get_types_from_idl(body))
    return {**_builtins(), **types}


def _builtins() -> dict[str, Any]:
    # some recorders omit these: no .msg file defines them
    fields = _jazzy().fielddefs
    return {name: fields[name] for name in (TIME, 'builtin_interfaces/msg/Duration')}


def _event_definition(name: str, text: str) -> str:
    """
    Return the definition of a service event, made from that of the service.

    rosbag2 stores the service's definition for its event topic.

    name : type of the event, such as 'std_srvs/msg/Trigger_Event'
    """
    own, *others = text.split(_SEPARATOR)
    request, _, response = own.partition('\n---\n')
    service = name.removesuffix(_EVENT_SUFFIX)
    parts = [
        _EVENT.format(name=service),
        f'MSG: {service}_Request\n{request}\n',
        f'MSG: {service}_Response\n{response}\n',
        'MSG: service_msgs/ServiceEventInfo\n' + definition('service_msgs/msg/ServiceEventInfo'),
        *(other.lstrip('\n') for other in others),
    ]
    return f'{_SEPARATOR}\n'.join(parts)
