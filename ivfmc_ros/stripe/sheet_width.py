# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Thickness of the light sheets as the stripes of a scan show it, by which a changed focus is seen.

A stripe in the image is as wide as the sheet is thick where it meets the surface, and as the lens
blurs it. How wide that is in pixels depends on the slope of the surface, which two profiles of
neighboring table angles give. The calibration of the laser measured the same with a flat board.
"""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Profile
from ivfmc_ros.stripe.stripe import Stripe

# A sheet that looks thicker or thinner by these factors is said. Rendered scans in focus are at
# 0.96 to 1.04, whatever the part; a blur as wide as the stripe makes it 1.4 times as wide.
MAX_THICKER, MIN_THINNER = 1.35, 0.7
# Points of a profile that are looked at, points of a scan that are needed, profiles of these.
_POINTS, _MIN_POINTS, _MIN_PROFILES = 60, 500, 20
# Rows to each side between which the direction of the stripe is taken.
_ROWS = 4
# The other profile is at a distance of at least so many sheets, and between these turns, radians:
# 200 profiles of a turn tell enough, and each costs half a millisecond.
_MIN_STEP, _MIN_TURN, _MAX_TURN = 1.0, 0.03, 0.2
# A step that is longer than this many arcs of the turn goes to another surface.
_MAX_STRETCH = 2.5
_MIN_FACING = 0.5  # cosine between surface normal and line of sight
_MAX_INTENSITY = 200.0  # gray values; clipped stripes are wide
_PIXEL_VARIANCE = 1.0 / 12.0  # square pixels, of a pixel's own extent


@dataclass(frozen=True, eq=False, kw_only=True)
class _Seen:
    """Points (n, 3) of a profile in ``turntable``, and the image rows (n,) that they are in."""

    profile: Profile
    rows: Ints


@dataclass(frozen=True, kw_only=True)
class SheetVerdict:
    """
    Whether the sheets are as thick as when they were calibrated.

    ratio : thickness over that of ``cell.yaml`` by laser, where it is known
    advice : what the operator can do; '' where the stripes are as wide as when calibrated
    """

    ratio: dict[str, float]
    advice: str


class SheetWidth:
    """Compares the stripes of one scan with the thickness of the sheets in ``cell.yaml``."""

    def __init__(self, cell: Cell) -> None:
        self._cell = cell
        self._seen: dict[int, _Seen] = {}
        self._found: dict[int, list[Floats]] = {}

    def add(self, profile: Profile, stripe: Stripe) -> None:
        """
        Add a profile, and the stripe that it was triangulated from.

        stripe : one entry for each row, or column, among them all of the profile
        """
        laser = self._cell.lasers[profile.laser]
        if not laser.thickness or not len(profile):
            return
        along = 1 if laser.stripe == 'rows' else 0
        now = _Seen(profile=profile, rows=np.rint(profile.uv[:, along]).astype(np.int64))
        before = self._seen.get(profile.laser)
        turn = np.inf if before is None else abs(profile.angle - before.profile.angle)
        is_other = before is None or before.profile.view != profile.view
        if before is None or is_other or not turn < _MAX_TURN:
            self._seen[profile.laser] = now
            return
        if turn < _MIN_TURN:
            return
        _, ours, theirs = np.intersect1d(now.rows, before.rows, return_indices=True)
        step = profile.points_xyz[ours] - before.profile.points_xyz[theirs]
        length = np.linalg.norm(step, axis=1)
        if not len(ours) or np.median(length) < _MIN_STEP * laser.thickness:
            # the next one is farther away
            return
        self._seen[profile.laser] = now
        arc = turn * np.linalg.norm(profile.points_xyz[ours, :2], axis=1)
        near = (length > _MIN_STEP * laser.thickness) & (length < _MAX_STRETCH * arc)
        found = self._thickness(now, stripe, ours[near], step[near])
        self._found.setdefault(profile.laser, []).append(found)

    def _thickness(self, now: _Seen, stripe: Stripe, chosen: Ints, across: Floats) -> Floats:
        """Return the thickness (n,) meters, 1 sigma, at some of the points that were chosen."""
        profile, cell = now.profile, self._cell
        inside = (chosen >= _ROWS) & (chosen < len(profile) - _ROWS)
        chosen, across = chosen[inside], across[inside]
        # on one piece of the stripe
        whole = now.rows[chosen + _ROWS] - now.rows[chosen - _ROWS] == 2 * _ROWS
        some = np.flatnonzero(whole)[:: max(1, int(whole.sum()) // _POINTS)]
        chosen, across = chosen[some], across[some]
        points = profile.points_xyz
        normals = np.cross(points[chosen + _ROWS] - points[chosen - _ROWS], across)
        turned = normals @ transforms.rotation_z(np.array([profile.angle]))[0].T
        turned = turned @ cell.turntable.camera_from_base[:3, :3].T
        turned /= np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-30)
        laser = cell.lasers[profile.laser]
        rays = cell.camera.rays(profile.uv[chosen])
        depth = laser.intersect(rays)[:, 2]
        change = cell.camera.ray_jacobian(rays, 'u' if laser.stripe == 'rows' else 'v')
        facing = (turned * rays).sum(axis=1)
        with np.errstate(invalid='ignore', divide='ignore'):
            # derivative of the point on the surface by the pixel coordinate
            slope = change - rays * ((turned * change).sum(axis=1) / facing)[:, None]
            per_pixel = np.abs(depth * (slope @ laser.normal))
            cosine = np.abs(facing) / np.linalg.norm(rays, axis=1)
        width = _widths(stripe, now.rows[chosen], 1 if laser.stripe == 'rows' else 0)
        thickness = per_pixel * np.sqrt(np.maximum(width**2 - _PIXEL_VARIANCE, 0.0))
        good = (cosine > _MIN_FACING) & (profile.intensity[chosen] < _MAX_INTENSITY)
        return np.asarray(thickness[good & np.isfinite(thickness)])

    def _ratio(self, laser: int) -> float | None:
        """Return the median thickness over that of ``cell.yaml``; None for too few points."""
        found = self._found.get(laser, [])
        values = np.concatenate([np.zeros(0), *found])
        if len(values) < _MIN_POINTS or len(found) < _MIN_PROFILES:
            return None
        return float(np.median(values)) / self._cell.lasers[laser].thickness

    def judge(self) -> SheetVerdict:
        """Return what the stripes so far say about the focus."""
        ratios = {laser: self._ratio(laser) for laser in sorted(self._found)}
        known = {self._cell.lasers[k]: ratio for k, ratio in ratios.items() if ratio is not None}
        return SheetVerdict(
            ratio={plane.name: ratio for plane, ratio in known.items()},
            advice='; '.join(filter(None, (_advice(*item) for item in known.items()))),
        )


def _advice(plane: LaserPlane, ratio: float) -> str:
    if MIN_THINNER <= ratio <= MAX_THICKER:
        return ''
    begin = (
        f'laser {plane.name}: its sheet looks {ratio:.2f} times as thick as when it was '
        f'calibrated ({1e3 * plane.thickness:.3f} mm, 1 sigma): '
    )
    if ratio < 1.0:
        return begin + 'the focus of camera or laser was changed; calibrate both again'
    return begin + (
        'the focus of camera or laser was changed (calibrate both again), the exposure is '
        'far too long, or the material scatters light'
    )


def _widths(stripe: Stripe, rows: Ints, along: int) -> Floats:
    """Return the widths (n,) pixels of the stripe in some rows; NaN where it has none."""
    own = np.rint(stripe.uv[:, along]).astype(np.int64)
    order = np.argsort(own, kind='stable')
    place = np.minimum(np.searchsorted(own[order], rows), len(own) - 1)
    index = order[place]
    return np.where(own[index] == rows, stripe.width[index], np.nan)
