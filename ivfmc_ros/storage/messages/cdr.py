# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
ROS 2 messages as bytes and back, without ROS.

What is written follows the message definitions of ROS 2 Jazzy; what is read follows the
definitions that the bag carries.
"""

from collections.abc import Callable
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

# what damaged or unsuitable bytes make the decoder raise, older versions of it included
_DECODING = (SerdeError, struct.error, ValueError, KeyError, IndexError, AssertionError)

# bytes: what CDR begins with, and a stamp
_LEADING = 12

_SEPARATOR = '=' * 80
_EVENT_SUFFIX = '_Event'
_EVENT = """service_msgs/ServiceEventInfo info
{name}_Request[<=1] request
{name}_Response[<=1] response
"""
# Types whose fields the scanner reads.
_READ = frozenset(
    f'sensor_msgs/msg/{name}'
    for name in ('CameraInfo', 'CompressedImage', 'Image', 'JointState', 'PointCloud2')
)


@cache
def _jazzy() -> Any:
    return get_typestore(Stores.ROS2_JAZZY)


def full_name(name: str) -> str:
    """Return a type's name as package/msg/Type; 'sensor_msgs/Image' and services' come so too."""
    package, _, rest = name.partition('/')
    return f'{package}/msg/{rest.rpartition("/")[2]}'


def knows(msgtype: str) -> bool:
    """Tell whether a message type such as 'sensor_msgs/msg/Image' is one of Jazzy's."""
    return msgtype in _jazzy().fielddefs


@cache
def definition(msgtype: str) -> str:
    """Return the text of a message definition and of all that it contains (ros2msg)."""
    text, _ = _jazzy().generate_msgdef(msgtype, ros_version=2)
    return str(text)


@cache
def type_hash(msgtype: str) -> str:
    """Return the RIHS01 hash of a message definition (REP 2011)."""
    return str(_jazzy().hash_rihs01(msgtype))


def message(msgtype: str, **fields: Any) -> Any:
    """Return a message; every field is given, arrays of numbers as arrays of the right type."""
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


def leading_stamp_ns(data: bytes) -> int:
    """
    Return the stamp, in nanoseconds, of an encoded message that begins with a header.

    :raises BagError: it is too short for one
    """
    if len(data) < _LEADING:
        raise BagError(f'{len(data)} bytes have no header')
    order: Literal['little', 'big'] = 'little' if data[1] & 1 else 'big'
    seconds = int.from_bytes(data[4:8], order, signed=True)
    return seconds * NANOSECONDS + int.from_bytes(data[8:12], order)


def encode(message: Any) -> bytes:
    """Return a message as CDR, little endian."""
    return bytes(_jazzy().serialize_cdr(message, message.__msgtype__, little_endian=True))


def decoder(name: str, encoding: str, text: str) -> Callable[[bytes], Any]:
    """
    Return a function that decodes CDR of either byte order by a bag's own definition.

    name : the type, such as 'sensor_msgs/msg/Image'
    encoding, text : 'ros2msg' or 'ros2idl', and the definitions in it
    The function raises BagError for bytes that do not fit the definition.

    :raises BagError: the definition cannot be understood
    """
    store = get_typestore(Stores.EMPTY)
    name = full_name(name)
    try:
        types = _parse(name, encoding, text)
        store.register(types)
        store.get_msgdef(name)
        _require_fields(name, [field for field, _ in store.fielddefs[name][1]])
    except (TypesysError, *_DECODING) as error:
        raise BagError(f'the definition of {name} cannot be understood: {error}') from error

    def decode(data: bytes) -> Any:
        try:
            return store.deserialize_cdr(data, name)
        except _DECODING as error:
            raise BagError(f'{len(data)} bytes are no {name}: {error}') from error

    return decode


def _require_fields(name: str, there: list[str]) -> None:
    # other types may be of another release of ROS, and are only passed on
    needed = [field for field, _ in _jazzy().fielddefs[name][1]] if name in _READ else []
    missing = [field for field in needed if field not in there]
    if missing:
        raise ValueError(f'it has no field {missing[0]!r}; its fields are {", ".join(there)}')


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
        # each file comes under a line with its name
        body = part.partition('\n')[2] if part.startswith('IDL: ') else part
        if body.strip():
            types.update(get_types_from_idl(body))
    return {**_builtins(), **types}


def _builtins() -> dict[str, Any]:
    # some writers leave these out of the text, because no message file defines them
    fields = _jazzy().fielddefs
    return {name: fields[name] for name in (TIME, 'builtin_interfaces/msg/Duration')}


def _event_definition(name: str, text: str) -> str:
    """
    Return the definition of a service event; rosbag2 stores that of the service in its place.

    name : such as 'std_srvs/msg/Trigger_Event'
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
