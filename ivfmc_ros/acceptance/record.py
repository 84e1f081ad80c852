# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An acceptance test as JSON, for the certificate and for the record beside ``cell.yaml``."""

from collections.abc import Mapping
from datetime import datetime
from datetime import UTC
import json
from pathlib import Path
from typing import Any

from ivfmc_ros import files
from ivfmc_ros.acceptance.check import Characteristic
from ivfmc_ros.acceptance.check import Check


def check_document(check: Check, calibration: str, source: str) -> dict[str, Any]:
    """
    Return a test as JSON. Lengths are meters.

    calibration : ``calibration_id`` of the cell, '' if it is not known
    source : scan or mesh that was measured
    """
    conditions = check.conditions
    return {
        'created': datetime.now(UTC).replace(microsecond=0).isoformat(),
        'calibration': calibration,
        'source': source,
        'artifact': str(check.artifact),
        'artifact_u_m': check.artifact.u,
        'temperature_c': conditions.temperature,
        'temperature_u_k': conditions.temperature_u,
        'expansion_per_k': conditions.expansion,
        'points': len(check.points_xyz),
        'coverage': list(check.coverage),
        'left_out': check.left_out,
        'characteristics': [_characteristic(one) for one in check.characteristics],
        'verdict': check.verdict,
    }


def _characteristic(one: Characteristic) -> dict[str, Any]:
    return {
        'name': one.name,
        'symbol': one.symbol,
        'value_m': one.value,
        'measured_m': one.measured,
        'nominal_m': one.nominal,
        'limit_m': one.limit,
        'u_test_m': one.u_test,
        'u_cell_m': one.u_cell,
        'normalized_error': one.normalized_error,
        'verdict': one.verdict,
    }


def write_record(path: Path, document: Mapping[str, Any]) -> None:
    """:raises FileError: the file cannot be written."""
    files.write_text(path, json.dumps(document, indent=2, allow_nan=False) + '\n')
