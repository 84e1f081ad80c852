# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Reading and writing of the table angle of each picture, a YAML file.

``ivfmc calibrate turntable`` writes it, ``ivfmc import-images`` reads it::

    version: 1
    angles:            # radians, positive counter-clockwise about +z
      step_num1.jpg: 0.0
      step_num2.jpg: 0.01963
"""

from collections.abc import Mapping
import math
from pathlib import Path

import yaml

from ivfmc_ros import files
from ivfmc_ros.errors import FileError
from ivfmc_ros.file_kinds import ANGLES
from ivfmc_ros.file_kinds import kind_of_file
from ivfmc_ros.file_kinds import require_kind

VERSION = 1


def load_angles(path: Path) -> dict[str, float]:
    """
    Read the table angle in radians of each picture, by file name.

    :raises FileError: a key is missing or its value is no angle; names the file and the key
    """
    document = _read(path)
    require_kind(path, document, ANGLES, FileError)
    unknown = [str(key) for key in document if key not in ('version', 'angles')]
    if unknown:
        raise FileError(f'{path}: unknown key {unknown[0]!r}; known are version, angles')
    if document.get('version') != VERSION:
        raise FileError(f'{path}: version: must be {VERSION}, is {document.get("version")!r}')
    angles = document.get('angles')
    if not isinstance(angles, dict) or not angles:
        raise FileError(f'{path}: angles: must be a mapping of file names to radians')
    return {str(name): _parse_angle(path, name, value) for name, value in angles.items()}


def save_angles(path: Path, angles: Mapping[str, float]) -> None:
    """
    Write the table angle in radians of each picture, by file name.

    :raises FileError: the file cannot be written
    """
    document = {
        'version': VERSION,
        'angles': {name: float(angle) for name, angle in angles.items()},
    }
    files.write_text(path, yaml.safe_dump(document, sort_keys=False))


def _read(path: Path) -> dict[str, object]:
    try:
        document = yaml.safe_load(files.read_bytes(path))
    except yaml.YAMLError as error:
        what = kind_of_file(path)
        reason = f'{what}; {ANGLES} is needed here' if what else f'not YAML: {error}'
        raise FileError(f'{path}: is {reason}') from error
    if not isinstance(document, dict):
        if kind := kind_of_file(path):
            raise FileError(f'{path}: is {kind}; {ANGLES} is needed here')
        raise FileError(f'{path}: must be a mapping with the keys version and angles')
    return document


def _parse_angle(path: Path, name: object, value: object) -> float:
    # PyYAML implements YAML 1.1, in which 4e-5 without a decimal point is a text
    if isinstance(value, str | int | float) and not isinstance(value, bool):
        try:
            angle = float(value)
        except ValueError:
            angle = math.nan
        if math.isfinite(angle):
            return angle
    raise FileError(f'{path}: angles: {name}: {value!r} is not a finite number of radians')
