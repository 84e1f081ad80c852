# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The temperature that a sensor gives during a scan, kept in the scan's folder."""

from dataclasses import asdict
from dataclasses import dataclass
from dataclasses import replace
import json
import math
from pathlib import Path
from typing import Any

from ivfmc_ros import files
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.inspection.conditions import Conditions

TEMPERATURE_FILE = 'temperature.json'


@dataclass(frozen=True, kw_only=True)
class ScanTemperature:
    """
    Temperature during a scan, degrees Celsius.

    mean_c, low_c, high_c : of the readings
    u_k : standard uncertainty of the mean, K: of the sensor, and of a temperature that changes
    readings : their number
    """

    mean_c: float
    u_k: float
    low_c: float
    high_c: float
    readings: int

    def applied_to(self, conditions: Conditions, where: Path) -> Conditions:
        """
        Return conditions at this temperature.

        :raises FileError: ``where``, the file it was read from, states an impossible temperature
        """
        try:
            return replace(conditions, temperature=self.mean_c, temperature_u=self.u_k)
        except ParameterError as error:
            raise FileError(f'{where}: {error}') from None


class TemperatureLog:
    """Collects the readings of a sensor while a scan runs."""

    def __init__(self, sensor_u: float) -> None:
        """``sensor_u`` : K, standard uncertainty of a sensor that states no variance."""
        self._sensor_u = sensor_u
        self._count, self._sum = 0, 0.0
        self._low, self._high, self._u = math.inf, -math.inf, 0.0

    def add(self, celsius: float, variance: float) -> None:
        """
        Add a reading; one that is not a number is left out.

        variance : K^2; 0 stands for unknown (sensor_msgs/Temperature)
        """
        if not math.isfinite(celsius):
            return
        self._count += 1
        self._sum += celsius
        self._low, self._high = min(self._low, celsius), max(self._high, celsius)
        known = math.isfinite(variance) and variance > 0.0
        self._u = max(self._u, math.sqrt(variance) if known else self._sensor_u)

    def summary(self) -> ScanTemperature | None:
        """Return the temperature of all readings; None without any."""
        if not self._count:
            return None
        # readings are taken to be anywhere between the extremes
        spread = (self._high - self._low) / math.sqrt(12.0)
        return ScanTemperature(
            mean_c=self._sum / self._count,
            u_k=math.hypot(self._u, spread),
            low_c=self._low,
            high_c=self._high,
            readings=self._count,
        )


def drift_text(found: ScanTemperature, calibrated: Any, limit: float) -> str:
    """
    Return a warning where the cell is warmer or colder than when it was calibrated; or ''.

    calibrated : ``temperature_c`` of cell.yaml; None where it states none
    limit : K
    """
    if not isinstance(calibrated, int | float) or abs(found.mean_c - calibrated) <= limit:
        return ''
    return (
        f'the cell was calibrated at {calibrated:g} C and has {found.mean_c:.1f} C now, more than '
        f'{limit:g} K apart: check it (ivfmc calibrate check), or calibrate it again'
    )


def save_temperature(folder: Path, found: ScanTemperature) -> None:
    """:raises FileError: the file cannot be written."""
    files.write_text(folder / TEMPERATURE_FILE, json.dumps(asdict(found), indent=2) + '\n')


def load_temperature(folder: Path) -> ScanTemperature | None:
    """
    Return the temperature of a scan; None where no sensor gave one.

    :raises FileError: the file is damaged
    """
    path = folder / TEMPERATURE_FILE
    if not path.is_file():
        return None
    try:
        return ScanTemperature(**json.loads(files.read_bytes(path)))
    except (ValueError, TypeError) as error:
        raise FileError(f'{path}: is damaged: {error}') from None
