# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Environment variables of a process that runs a node. No ROS.

ROS wheels look up message types by AMENT_PREFIX_PATH, which a sourced workspace sets, and Fast DDS
needs a profile file for shared-memory segments that hold images. A cell that turns and shines is
not offered to a whole network unless the variables of ROS say so.
"""

from collections.abc import Mapping
import os
from pathlib import Path
import sys

from ivfmc_ros.errors import FileError

PACKAGE = 'ivfmc_ros'
# Each says how far a participant is seen; the second is that of older distributions.
_DISCOVERY = ('ROS_AUTOMATIC_DISCOVERY_RANGE', 'ROS_LOCALHOST_ONLY')
_PROFILES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')


def config_file(name: str) -> Path:
    """
    Return the path of a file of ``config/``, in a checkout or in an installed package.

    :raises FileError: there is no such file
    """
    prefixes = [sys.prefix, *os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)]
    folders = [
        Path(__file__).resolve().parents[3] / 'config',
        *(Path(prefix) / 'share' / PACKAGE / 'config' for prefix in prefixes if prefix),
    ]
    for folder in folders:
        if (folder / name).is_file():
            return folder / name
    raise FileError(f'config/{name}: not found in {", ".join(map(str, folders))}')


def missing(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the variables that ``environment`` lacks; variables that are set are kept."""
    found: dict[str, str] = {}
    prefix = Path(sys.prefix)
    if not environment.get('AMENT_PREFIX_PATH') and (prefix / 'share' / 'ament_index').is_dir():
        found['AMENT_PREFIX_PATH'] = str(prefix)
    if not any(environment.get(name) for name in _PROFILES):
        found[_PROFILES[0]] = str(config_file('fastdds.xml'))
    if not any(environment.get(name) for name in _DISCOVERY):
        found[_DISCOVERY[0]] = 'LOCALHOST'
    return found


def child_environment(**extra: str) -> dict[str, str]:
    """Return the environment of a child process that runs a node, with ``extra`` added."""
    environment = {**os.environ, **extra}
    return {**environment, **missing(environment)}


def prepare() -> None:
    """Add the missing variables to this process; to be called before rclpy.init."""
    os.environ.update(missing(os.environ))
