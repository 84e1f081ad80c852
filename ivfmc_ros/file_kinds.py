# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recognizes the kind of a file by its keys or first bytes, to name a file that was mixed up."""

from collections.abc import Mapping
from pathlib import Path

import yaml

from ivfmc_ros.errors import CellError
from ivfmc_ros.errors import FileError

CELL = 'a cell file (cell.yaml)'
CAMERA = 'a camera calibration (camera.yaml)'
ANGLES = 'a file of table angles (angles.yaml)'
NOISE = 'a noise model of a camera (noise.yaml)'
BAG = 'the metadata.yaml of a bag'
PARAMETERS = 'a parameter file of ROS 2 nodes'

# Keys that only one kind of file has.
_KEYS = {
    'camera_matrix': CAMERA,
    'image_width': CAMERA,
    'turntable': CELL,
    'lasers': CELL,
    'camera_frame': CELL,
    'angles': ANGLES,
    'electrons_per_dn': NOISE,
    'rosbag2_bagfile_information': BAG,
}
_HEADS = {
    b'\x89MCAP0\r\n': 'an MCAP bag',
    b'#ROSBAG V': 'a ROS 1 bag',
    b'SQLite format 3\x00': 'an SQLite file (a bag or the catalogue)',
    b'ply': 'a PLY mesh',
    b'solid ': 'an STL mesh',
    b'glTF': 'a GLB mesh',
    b'\x89PNG': 'a PNG picture',
    b'\xff\xd8\xff': 'a JPEG picture',
    b'PK\x03\x04': 'a ZIP archive',
    b'ISO-10303-21': 'a STEP file',
}
# YAML files are smaller, bytes; a larger file is not read to find out what it is.
_MAX_YAML = 1_000_000


def kind_of_keys(document: object) -> str:
    """Return the kind of a YAML document, '' where it is not known."""
    if not isinstance(document, Mapping):
        return ''
    for key, kind in _KEYS.items():
        if key in document:
            return kind
    values = [value for value in document.values() if isinstance(value, Mapping)]
    return PARAMETERS if any('ros__parameters' in value for value in values) else ''


def kind_of_data(data: bytes) -> str:
    """Return the kind of a file that is not YAML by its first bytes, '' where it is not known."""
    return next((kind for head, kind in _HEADS.items() if data.startswith(head)), '')


def kind_of_file(path: Path) -> str:
    """Return the kind of a file or folder, '' where it is not known or cannot be read."""
    try:
        if path.is_dir():
            return 'a folder'
        with path.open('rb') as stream:
            data = stream.read(_MAX_YAML)
        return kind_of_data(data) or kind_of_keys(yaml.safe_load(data))
    except (OSError, ValueError, yaml.YAMLError, RecursionError):
        return ''


def require_kind(
    path: Path, document: object, wanted: str, error: type[FileError] = CellError
) -> None:
    """
    Check that a YAML document is not one of another kind.

    wanted : its kind, such as ``CELL``
    :raises FileError: or ``error``, it is of another kind
    """
    found = kind_of_keys(document)
    if found and found != wanted:
        raise error(f'{path}: is {found}; {wanted} is needed here')
