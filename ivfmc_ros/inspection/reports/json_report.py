# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writer of ``report.json``: settings, residuals and results of a scan or an inspection."""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import asdict
from datetime import date
from datetime import datetime
from datetime import UTC
import json
import math
from pathlib import Path
from typing import Any
from typing import TYPE_CHECKING

import numpy as np

from ivfmc_ros import __version__
from ivfmc_ros import files
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.model import View

if TYPE_CHECKING:
    # imports open3d, which takes seconds
    from ivfmc_ros.registration.align import Verdict


def write_report(path: Path, document: Mapping[str, Any]) -> None:
    """
    Write a report as JSON; a number that is not finite becomes null.

    :raises FileError: it cannot be written
    """
    now = datetime.now(UTC).replace(microsecond=0).isoformat().replace('+00:00', 'Z')
    whole = {'ivfmc_ros': __version__, 'created': now, **document}
    files.write_text(path, json.dumps(_plain(whole), indent=2, allow_nan=False) + '\n')


def residuals(cell: Cell, views: Sequence[View], verdicts: 'Sequence[Verdict]') -> dict[str, Any]:
    """Return what is left over: of the calibration, of the registration, and the claimed sigma."""
    sigma = np.concatenate([view.sigma[view.valid] for view in views])
    return {
        'calibration': {
            'laser_rms_m': {laser.name: laser.residual_rms for laser in cell.lasers},
            'turntable_rms_m': cell.turntable.residual_rms,
        },
        'point_sigma_m': {
            'median': float(np.median(sigma)),
            'p95': float(np.percentile(sigma, 95)),
        },
        'registration': [asdict(verdict) for verdict in verdicts],
        'registration_checked': any(verdict.checked for verdict in verdicts),
    }


def scale(cell: Cell) -> dict[str, Any]:
    """Return which known length every figure of the scan rests on."""
    board = cell.notes.get('board')
    return {'board': board} if board else {'board': None, 'note': 'the cell names no known length'}


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, date):  # YAML makes one of what a cell notes; a datetime is one too
        return value.isoformat()
    if isinstance(value, Path):
        return str(value)
    return None if isinstance(value, float) and not math.isfinite(value) else value
