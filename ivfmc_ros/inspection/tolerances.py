# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Tolerances of the features of a part, from a YAML file; lengths in the file are millimeters."""

from collections.abc import Iterable
from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field
from pathlib import Path
from typing import Any

import yaml

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.inspection.verdict import require_tolerance
from ivfmc_ros.validation import suggestion

_MM = 1e-3
# What is tolerated of a feature. Surface and diameter may deviate by the tolerance to either side;
# the others are zones of that width (ISO 1101).
TWO_SIDED = ('surface', 'diameter')
ZONES = ('flatness', 'cylindricity', 'roundness', 'straightness', 'sphericity', 'position')
CHARACTERISTICS = (*TWO_SIDED, *ZONES)


@dataclass(frozen=True, kw_only=True)
class Tolerances:
    """
    Tolerances in meters.

    default : of surfaces and diameters, to either side; zones are twice as wide by default
    features : name of a feature, such as 'cylinder 3', to its tolerances by characteristic
    :raises ParameterError: a value is not positive, or a characteristic is unknown
    """

    default: float = 0.1e-3
    features: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_tolerance(self.default)
        for name, given in self.features.items():
            for characteristic, value in given.items():
                if characteristic not in CHARACTERISTICS:
                    hint = suggestion(characteristic, CHARACTERISTICS)
                    raise ParameterError(
                        f'tolerances: {name}: {characteristic!r} is not one of '
                        f'{", ".join(CHARACTERISTICS)}{hint}'
                    )
                require_tolerance(value, f'tolerances: {name}: {characteristic}')

    def of(self, feature: str, characteristic: str) -> float:
        """Return the tolerance of a feature, or the default, meters."""
        given = self.features.get(feature, {}).get(characteristic)
        if given is not None:
            return given
        return 2.0 * self.default if characteristic in ZONES else self.default

    def require_known(self, names: Iterable[str]) -> None:
        """
        Check that all features exist.

        names : of the features of the nominal
        :raises ParameterError: a feature is not among them
        """
        known = list(names)
        for name in self.features:
            if name not in known:
                raise ParameterError(
                    f'tolerances: the nominal has no feature {name!r}{suggestion(name, known)}; '
                    f'it has {", ".join(known)}'
                )


def load_tolerances(path: Path, default: float) -> Tolerances:
    """
    Read tolerances, for example ``{default: 0.1, features: {cylinder 3: {diameter: 0.05}}}``.

    A number instead of characteristics holds for surface and diameter.

    default : meters, if the file has none
    :raises ParameterError: the file cannot be read, or an entry is wrong; it is named
    """
    try:
        read = yaml.safe_load(path.read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ParameterError(f'{path}: cannot be read as YAML ({error})') from error
    if not isinstance(read, Mapping) or set(read) - {'default', 'features'}:
        raise ParameterError(
            f"{path}: needs the keys 'default' (a number, mm) and 'features' (by name)"
        )
    try:
        return Tolerances(
            default=_meters('default', read['default']) if 'default' in read else default,
            features=feature_tolerances(read.get('features')),
        )
    except ParameterError as error:
        raise ParameterError(f'{path}: {error}') from None


def feature_tolerances(given: Any) -> dict[str, dict[str, float]]:
    """
    Return tolerances in meters by feature and characteristic.

    given : as in a file, lengths in mm: {'cylinder 3': {'diameter': 0.05}, 'plane 1': 0.1}; None
        for none
    :raises ParameterError: it has another form
    """
    features = {} if given is None else given
    if not isinstance(features, Mapping):
        raise ParameterError("features: needs names, such as 'cylinder 3'")
    return {str(name): _feature(str(name), values) for name, values in features.items()}


def _feature(name: str, given: Any) -> dict[str, float]:
    if not isinstance(given, Mapping):
        return dict.fromkeys(TWO_SIDED, _meters(name, given))
    return {str(key): _meters(f'{name}: {key}', value) for key, value in given.items()}


def _meters(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ParameterError(f'tolerances: {name}: {value!r} is no number of millimeters')
    return _MM * value
