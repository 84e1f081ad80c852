# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Typed access to YAML mappings; errors name the file, the key and the reason."""

import codecs
from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import replace
from datetime import datetime
import math
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ivfmc_ros import files
from ivfmc_ros.errors import CellError
from ivfmc_ros.errors import FileError
from ivfmc_ros.file_kinds import kind_of_file
from ivfmc_ros.model import Floats
from ivfmc_ros.validation import suggestion

# First line of a file of OpenCV, in a form that YAML forbids; new versions write '%YAML 1.0'.
_OPENCV_HEAD = b'%YAML:'
# Type of its matrices.
_OPENCV_MATRIX = b'!!opencv-matrix'


class _OpenCvLoader(yaml.SafeLoader):
    """Reads matrices of OpenCV as mappings with rows, cols, dt and data."""


_OpenCvLoader.add_constructor(
    'tag:yaml.org,2002:opencv-matrix',
    lambda loader, node: dict(loader.construct_pairs(node, deep=True)),
)


def load_yaml(data: bytes) -> tuple[Any, bool]:
    """
    Parse a YAML file, with or without a byte-order mark, or a file of OpenCV.

    returns : its document, and whether OpenCV wrote it
    :raises yaml.YAMLError: it is neither
    """
    text = data.removeprefix(codecs.BOM_UTF8)
    if _OPENCV_MATRIX not in text:
        return yaml.safe_load(text), False
    if text.startswith(_OPENCV_HEAD):
        text = text.replace(b':', b' ', 1)
    return yaml.load(text, Loader=_OpenCvLoader), True


@dataclass(frozen=True)
class YamlMapping:
    """
    A mapping of a YAML file.

    where : the file and the path of keys to the mapping, with which error messages begin
    is_opencv : the file was written by OpenCV (``cv::FileStorage``)
    """

    where: str
    values: Mapping[str, Any]
    is_opencv: bool = False

    @classmethod
    def read(cls, path: Path) -> 'YamlMapping':
        """
        Read a YAML file whose top level is a mapping.

        :raises CellError: the file cannot be read, is not YAML, or is no mapping
        """
        try:
            values, is_opencv = load_yaml(files.read_bytes(path))
        except FileError as error:
            raise CellError(str(error)) from error
        except yaml.YAMLError as error:
            kind = kind_of_file(path)
            reason = f'{kind}, a YAML file is needed here' if kind else f'not YAML: {error}'
            raise CellError(f'{path}: is {reason}') from error
        if not isinstance(values, dict) and (kind := kind_of_file(path)):
            raise CellError(f'{path}: is {kind}, a YAML file is needed here')
        return replace(cls.of(str(path), values), is_opencv=is_opencv)

    @classmethod
    def of(cls, where: str, values: object) -> 'YamlMapping':
        """
        Wrap ``values``.

        :raises CellError: they are not a mapping
        """
        if not isinstance(values, dict):
            raise CellError(f'{where}: must be a mapping of keys to values')
        return cls(where, values)

    def require_known_keys(self, *keys: str) -> None:
        """:raises CellError: there is a key other than ``keys``."""
        unknown = [str(key) for key in self.values if key not in keys]
        if unknown:
            hint = suggestion(unknown[0], keys) or f'; known are {", ".join(keys)}'
            raise CellError(f'{self.where}: unknown key {unknown[0]!r}{hint}')

    def error(self, key: str, reason: str) -> CellError:
        """Return an error that names the file, the key and the reason."""
        return CellError(f'{self.where}: {key}: {reason}')

    def required(self, key: str) -> Any:
        """Return the value of ``key``; :raises CellError: it is missing."""
        if key not in self.values:
            raise self.error(key, 'is missing')
        return self.values[key]

    def has(self, key: str) -> bool:
        """Return whether ``key`` is given and not null."""
        return self.values.get(key) is not None

    def mapping(self, key: str) -> 'YamlMapping':
        """Return a mapping; :raises CellError: the value is none."""
        return YamlMapping.of(f'{self.where}: {key}', self.required(key))

    def text(self, key: str) -> str:
        """Return a text; :raises CellError: the value is no text, or empty."""
        value = self.required(key)
        if not isinstance(value, str) or not value:
            raise self.error(key, 'must be a text')
        return value

    def timestamp(self, key: str) -> str:
        """Return an ISO 8601 time as text; :raises CellError: the value is none."""
        value = self.required(key)
        # YAML parses an unquoted time to a datetime
        if isinstance(value, datetime):
            return value.isoformat().replace('+00:00', 'Z')
        try:
            datetime.fromisoformat(str(value))
        except ValueError:
            raise self.error(key, 'must be an ISO 8601 time') from None
        return str(value)

    def number(self, key: str) -> float:
        """Return a finite number; :raises CellError: the value is none."""
        return self._number(key, self.required(key))

    def positive_integer(self, key: str) -> int:
        """Return a positive integer; :raises CellError: the value is none."""
        value = self.required(key)
        if isinstance(value, bool) or not isinstance(value, int) or value <= 0:
            raise self.error(key, 'must be a positive whole number')
        return value

    def array(self, key: str, count: int) -> Floats:
        """
        Return a flat list of ``count`` finite numbers as (count,) float64.

        :raises CellError: the value is none
        """
        value = self.required(key)
        if not isinstance(value, list) or len(value) != count:
            raise self.error(key, f'must be a list of {count} numbers')
        return np.array([self._number(key, item) for item in value])

    def numbers(self, key: str) -> Floats:
        """Return a flat list of finite numbers; :raises CellError: the value is none."""
        value = self.required(key)
        return self.array(key, len(value) if isinstance(value, list) else 0)

    def _number(self, key: str, value: object) -> float:
        # PyYAML implements YAML 1.1, in which 4e-5 without a decimal point is a text
        if isinstance(value, str | int | float) and not isinstance(value, bool):
            try:
                number = float(value)
            except ValueError:
                number = math.nan
            if math.isfinite(number):
                return number
        raise self.error(key, f'{value!r} is not a finite number')
