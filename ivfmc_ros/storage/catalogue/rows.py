# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rows of the catalogue as values."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True, kw_only=True)
class ScanRow:
    """
    A scan.

    key : its number in the database
    created : ISO 8601 in UTC
    verdict : of the last inspection, '' without one
    calibration : SHA-256 of its cell.yaml, '' where it is not known
    folder : has its files
    deleted : when it was moved to the trash, '' where it was not
    """

    key: int
    scan_id: str
    cell: str
    part: str
    recipe: str
    created: str
    stage: str
    code: str
    verdict: str
    calibration: str
    folder: Path
    parameters: Mapping[str, Any]
    deleted: str = ''


@dataclass(frozen=True, kw_only=True)
class ViewRow:
    """A view: number of profiles and points, smallest and greatest table angle in radians."""

    view: int
    laser: int
    profiles: int
    points: int
    first_angle: float
    last_angle: float


@dataclass(frozen=True, kw_only=True)
class ProfileRow:
    """
    A profile and its location in the bag; angle in radians.

    message : index of the message in ``topic``, from 0
    chunk_offset : offset in the file of the chunk that holds the message, bytes
    """

    seq: int
    view: int
    laser: int
    angle: float
    points: int
    stamp_ns: int
    topic: str
    message: int
    log_time_ns: int
    chunk_offset: int
    speed: float = 0.0


@dataclass(frozen=True, kw_only=True)
class ResultRow:
    """A result (mesh) of a scan; one that is reconstructed with other settings has several."""

    number: int
    created: str
    folder: Path
    summary: Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class FeatureRow:
    """
    A measured value of a feature, from the last inspection of a scan; meters.

    uncertainty : expanded, k = 2; None where it is not known
    tolerance : greatest deviation to either side, or width of the zone of form and position
    """

    feature: str
    characteristic: str
    nominal: float | None
    measured: float | None
    uncertainty: float | None
    tolerance: float | None
    verdict: str


@dataclass(frozen=True, kw_only=True)
class FoundScan:
    """
    A scan of a list.

    views, profiles : their numbers
    value : the measured value that the list asked for, None where it asked for none
    """

    scan_id: str
    cell: str
    part: str
    recipe: str
    created: str
    stage: str
    code: str
    verdict: str
    deleted: str
    views: int
    profiles: int
    value: FeatureRow | None = None
