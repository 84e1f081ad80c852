# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Uncertainty of the scale of a cell: that of the known length, and what contradicts it."""

from collections.abc import Mapping
import math
from typing import Any

from ivfmc_ros.cell.covariance import CellCovariance

# Key of the note ``board``: relative difference between the two known lengths of a calibration.
DOUBT = 'scale_doubt'
# An unresolved difference is a rectangular distribution of that half-width (GUM 4.3.7).
_RECTANGULAR = 1.0 / math.sqrt(3.0)


def scale_doubt(notes: Mapping[str, Any]) -> float:
    """
    Return by how much known lengths of the calibration contradict each other; 0 if they do not.

    notes : of a cell
    returns : measured minus nominal over nominal length, signed
    """
    board = notes.get('board')
    value = board.get(DOUBT) if isinstance(board, Mapping) else None
    if not isinstance(value, int | float) or isinstance(value, bool):
        return 0.0
    return float(value) if math.isfinite(value) else 0.0


def scale_u(notes: Mapping[str, Any], covariance: CellCovariance | None) -> float | None:
    """
    Return the relative standard uncertainty of all lengths; None if the cell states none.

    An unresolved contradiction is part of it.
    """
    stated = None if covariance is None else covariance.scale_u
    doubt = abs(scale_doubt(notes)) * _RECTANGULAR
    return math.hypot(stated or 0.0, doubt) if doubt else stated


def doubt_text(notes: Mapping[str, Any]) -> str:
    """Return the doubt with its consequence, for reports; '' if there is none."""
    doubt = scale_doubt(notes)
    if not doubt:
        return ''
    return (
        f'the known lengths of the calibration differ by {100 * abs(doubt):.2f} %: lengths may be '
        f'{100 * abs(doubt):.2f} mm in 100 mm too {"large" if doubt > 0 else "small"}'
    )
