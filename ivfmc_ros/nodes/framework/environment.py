# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What a process of the graph needs in its environment. No ROS.

The wheels of ROS look for message types in AMENT_PREFIX_PATH, as a sourced workspace does, and
Fast DDS has shared memory for pictures only when told so.
"""

from collections.abc import Mapping
import os
from pathlib import Path
import sys

from ivfmc_ros.errors import FileError

PACKAGE = 'ivfmc_ros'
_PROFILES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')


def config_file(name: str) -> Path:
    """
    Return a file of ``config/``, in a checkout or where the package is installed.

    :raises FileError: there is none of this name
    """
    prefixes = [sys.prefix, *os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)]
    folders = [
        Path(__file__).resolve().parents[3] / 'config',
        *(Path(prefix) / 'share' / PACKAGE / 'config' for prefix in prefixes if prefix),
    ]
    for folder in folders:
        if (folder / name).is_file():
            return folder / name
    raise FileError(f'config/{name}: is not there; looked in {", ".join(map(str, folders))}')


def missing(environment: Mapping[str, str]) -> dict[str, str]:
    """Return what a process that runs a node lacks in its environment; what is set stays."""
    wanted: dict[str, str] = {}
    prefix = Path(sys.prefix)
    if not environment.get('AMENT_PREFIX_PATH') and (prefix / 'share' / 'ament_index').is_dir():
        wanted['AMENT_PREFIX_PATH'] = str(prefix)
    if not any(environment.get(name) for name in _PROFILES):
        wanted[_PROFILES[0]] = str(config_file('fastdds.xml'))
    return wanted


def child_environment(**extra: str) -> dict[str, str]:
    """Return the environment for a child process that runs a node, with ``extra`` added."""
    environment = {**os.environ, **extra}
    return {**environment, **missing(environment)}


def prepare() -> None:
    """Complete the environment of this process; before rclpy.init."""
    os.environ.update(missing(os.environ))
