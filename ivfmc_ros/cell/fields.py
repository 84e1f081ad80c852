# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reading of YAML mappings that names the file and the key of whatever is wrong."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
import math
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ivfmc_ros.errors import CellError
from ivfmc_ros.model import Floats


@dataclass(frozen=True)
class Fields:
    """A mapping of a YAML file; ``where`` is its place: the file, then the path of keys."""

    where: str
    values: Mapping[str, Any]

    @classmethod
    def read(cls, path: Path) -> 'Fields':
        """
        Read a YAML file whose top is a mapping.

        :raises CellError: the file cannot be read or is not such YAML
        """
        try:
            values = yaml.safe_load(path.read_text(encoding='utf-8'))
        except OSError as error:
            raise CellError(f'{path}: cannot be read: {error.strerror}') from error
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            raise CellError(f'{path}: is not YAML: {error}') from error
        return cls.of(str(path), values)

    @classmethod
    def of(cls, where: str, values: object) -> 'Fields':
        """
        Wrap ``values``.

        :raises CellError: they are not a mapping
        """
        if not isinstance(values, dict):
            raise CellError(f'{where}: must be a mapping of keys to values')
        return cls(where, values)

    def only(self, *keys: str) -> None:
        """:raises CellError: there is a key other than ``keys``."""
        unknown = [str(key) for key in self.values if key not in keys]
        if unknown:
            raise CellError(
                f'{self.where}: unknown key {unknown[0]!r}; known are {", ".join(keys)}'
            )

    def fail(self, key: str, problem: str) -> CellError:
        """Return the error that says ``problem`` of ``key``."""
        return CellError(f'{self.where}: {key}: {problem}')

    def get(self, key: str) -> Any:
        """:raises CellError: there is no such key."""
        if key not in self.values:
            raise self.fail(key, 'is missing')
        return self.values[key]

    def has(self, key: str) -> bool:
        """Tell whether ``key`` is given and not null."""
        return self.values.get(key) is not None

    def mapping(self, key: str) -> 'Fields':
        """:raises CellError: the value is not a mapping."""
        return Fields.of(f'{self.where}: {key}', self.get(key))

    def text(self, key: str) -> str:
        """:raises CellError: the value is not text, or empty."""
        value = self.get(key)
        if not isinstance(value, str) or not value:
            raise self.fail(key, 'must be a text')
        return value

    def time(self, key: str) -> str:
        """Return an ISO 8601 time as text; YAML turns an unquoted one into a datetime."""
        value = self.get(key)
        if isinstance(value, datetime):
            return value.isoformat().replace('+00:00', 'Z')
        try:
            datetime.fromisoformat(str(value))
        except ValueError:
            raise self.fail(key, 'must be an ISO 8601 time') from None
        return str(value)

    def number(self, key: str) -> float:
        """:raises CellError: the value is not a finite number."""
        return self._number(key, self.get(key))

    def count(self, key: str) -> int:
        """:raises CellError: the value is not a positive whole number."""
        value = self.get(key)
        if isinstance(value, bool) or not isinstance(value, int) or value <= 0:
            raise self.fail(key, 'must be a positive whole number')
        return value

    def array(self, key: str, count: int) -> Floats:
        """
        Return a flat list of ``count`` numbers, (count,) float64.

        :raises CellError: it is not one
        """
        value = self.get(key)
        if not isinstance(value, list) or len(value) != count:
            raise self.fail(key, f'must be a list of {count} numbers')
        return np.array([self._number(key, item) for item in value])

    def _number(self, key: str, value: object) -> float:
        # PyYAML follows YAML 1.1, in which 4e-5 without a dot is a text.
        if isinstance(value, str | int | float) and not isinstance(value, bool):
            try:
                number = float(value)
            except ValueError:
                number = math.nan
            if math.isfinite(number):
                return number
        raise self.fail(key, f'{value!r} is not a finite number')
