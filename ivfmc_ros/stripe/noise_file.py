# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``noise.yaml``: the noise of a camera, as ``ivfmc calibrate noise`` writes it."""

import math
from pathlib import Path

import yaml

from ivfmc_ros import files
from ivfmc_ros.cell.fields import Fields
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.stripe.noise import Noise

VERSION = 1


def load_noise(path: Path) -> Noise:
    """
    Read a noise file.

    :raises CellError: names the file and the key that is missing, unknown or impossible
    """
    fields = Fields.read(path)
    fields.only('version', 'read', 'electrons_per_dn', 'speckle')
    if fields.count('version') != VERSION:
        raise fields.fail('version', f'must be {VERSION}')
    shot = fields.number('electrons_per_dn') if fields.has('electrons_per_dn') else math.inf
    try:
        return Noise(
            read=fields.number('read'), electrons_per_dn=shot, speckle=fields.number('speckle')
        )
    except ParameterError as error:
        raise FileError(f'{path}: {error}') from None


def save_noise(path: Path, noise: Noise) -> None:
    """
    Write a noise file; no shot noise at all is written as null.

    :raises FileError: it cannot be written
    """
    shot = noise.electrons_per_dn
    document = {
        'version': VERSION,
        'read': round(noise.read, 4),
        'electrons_per_dn': round(shot, 4) if math.isfinite(shot) else None,
        'speckle': round(noise.speckle, 5),
    }
    files.write_text(path, yaml.safe_dump(document, sort_keys=False))
