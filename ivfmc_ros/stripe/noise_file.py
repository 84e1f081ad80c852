# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reading and writing ``noise.yaml``, the noise model that ``ivfmc calibrate noise`` writes."""

import math
from pathlib import Path

import yaml

from ivfmc_ros import files
from ivfmc_ros.cell.fields import YamlMapping
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.file_kinds import NOISE
from ivfmc_ros.file_kinds import require_kind
from ivfmc_ros.stripe.noise import SensorNoise

VERSION = 1


def load_noise(path: Path) -> SensorNoise:
    """
    Read a noise model.

    :raises CellError: a key is missing, unknown or invalid; the message names file and key
    :raises FileError: a value is out of range
    """
    fields = YamlMapping.read(path)
    require_kind(path, fields.values, NOISE)
    fields.require_known_keys('version', 'read', 'electrons_per_dn', 'speckle')
    if fields.positive_integer('version') != VERSION:
        raise fields.error('version', f'must be {VERSION}')
    shot = fields.number('electrons_per_dn') if fields.has('electrons_per_dn') else math.inf
    try:
        return SensorNoise(
            read=fields.number('read'), electrons_per_dn=shot, speckle=fields.number('speckle')
        )
    except ParameterError as error:
        raise FileError(f'{path}: {error}') from None


def save_noise(path: Path, noise: SensorNoise) -> None:
    """
    Write a noise model; ``electrons_per_dn`` is null without shot noise.

    :raises FileError: the file cannot be written
    """
    shot = noise.electrons_per_dn
    document = {
        'version': VERSION,
        'read': round(noise.read, 4),
        'electrons_per_dn': round(shot, 4) if math.isfinite(shot) else None,
        'speckle': round(noise.speckle, 5),
    }
    files.write_text(path, yaml.safe_dump(document, sort_keys=False))
