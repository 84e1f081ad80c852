# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A shape fitted to the points of a region, and fitted again with each of their errors.

A quantity of the shape, such as its diameter, is as uncertain as it varies over these fits.
"""

from collections.abc import Callable
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from ivfmc_ros.inspection import features
from ivfmc_ros.inspection.budget import Budget
from ivfmc_ros.inspection.uncertainty import CalibrationModes
from ivfmc_ros.inspection.verdict import GUARD
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints

# Points of the fits under errors; more do not reduce errors that neighboring points share.
_MAX_POINTS = 2_000
# The points of a region are split into 2**3 = 8 groups for the delete-a-group jackknife.
_HALVINGS = 3
# Step of the derivative by an error of the calibration, in standard deviations.
_STEP = 0.5

Measure = Callable[[features.Feature], float]


@dataclass(frozen=True, eq=False, kw_only=True)
class ErringPoints:
    """
    Points of a region with their errors, in the frame of the nominal.

    points_xyz : (n, 3) meters; normals : (n, 3) unit
    systematic : (n,) meters, 1 sigma along the normals of errors that neighboring points share
    modes : displacements by the calibration; None if a source of uncertainty is not known
    """

    points_xyz: Floats
    normals: Floats
    systematic: Floats
    modes: CalibrationModes | None


@dataclass(frozen=True, eq=False, kw_only=True)
class FeatureFit:
    """
    A shape, and the shapes with errors of the points.

    shape : fitted to all points
    base : fitted to those points that the other fits use
    left_out : without one group of points each
    shifted : with the systematic errors of all points, and of opposite sign on opposite sides of
        the feature along each axis
    erring : with half a standard deviation of an error of the calibration each, by its source;
        None if a source of uncertainty is not known
    form_components : standard uncertainty of the form error without noise, meters, by source: the
        range of the residuals that an error of one standard deviation causes
    """

    shape: features.Feature
    base: features.Feature
    left_out: list[features.Feature]
    shifted: list[features.Feature]
    erring: list[tuple[str, features.Feature]] | None
    form_components: Mapping[str, float]

    def budget(self, measure: Measure) -> Budget:
        """Return the uncertainty of a quantity of the shape."""
        value = measure(self.base)
        components = {
            'noise': jackknife_u([measure(shape) for shape in self.left_out]),
            'stripe bias': float(
                np.linalg.norm([measure(shape) - value for shape in self.shifted])
            ),
        }
        if self.erring is None:
            return Budget(components={**components, 'not known': float('nan')})
        for source in dict.fromkeys(name for name, _ in self.erring):
            moves = [
                (measure(shape) - value) / _STEP for name, shape in self.erring if name == source
            ]
            components[source] = float(np.linalg.norm(moves))
        return Budget(components=components)


def fit_feature(
    kind: str, points: ErringPoints, axis: Floats | None, *, fixed: bool
) -> FeatureFit:
    """
    Fit a shape to points and to points with errors.

    axis : approximate direction of a cylinder, fixed : it is exact
    :raises GeometryError: the points, or those without a group, do not determine the shape
    """

    def fit(xyz: Floats) -> features.Feature:
        return features.fit(kind, xyz, axis, fixed=fixed)

    whole = fit(points.points_xyz)
    chosen = np.arange(0, len(points.points_xyz), max(1, len(points.points_xyz) // _MAX_POINTS))
    few = points.points_xyz[chosen]
    group = split_groups(few, _HALVINGS)
    base = fit(few)
    shift = points.systematic[chosen, None] * points.normals[chosen]
    shifted = [fit(few + side[:, None] * shift) for side in _sides(few)]
    residuals = features.residuals(base, few)
    form = {'stripe bias': float(np.ptp(features.residuals(shifted[0], few + shift) - residuals))}
    erring = None
    if points.modes is None:
        form['not known'] = float('nan')
    else:
        moved = few + _STEP * points.modes.shifts[:, chosen]
        erring = [
            (source, fit(xyz)) for source, xyz in zip(points.modes.sources, moved, strict=True)
        ]
        ranges = [
            float(np.ptp(features.residuals(shape, xyz) - residuals)) / _STEP
            for (_, shape), xyz in zip(erring, moved, strict=True)
        ]
        for source in dict.fromkeys(points.modes.sources):
            own = [r for r, (name, _) in zip(ranges, erring, strict=True) if name == source]
            form[source] = float(np.linalg.norm(own))
    return FeatureFit(
        shape=whole,
        base=base,
        left_out=[fit(few[group != number]) for number in range(int(group.max()) + 1)],
        shifted=shifted,
        erring=erring,
        form_components=form,
    )


def _sides(points: Floats) -> list[Floats]:
    """Return signs (n,) of an error: the same everywhere, and opposite on opposite sides."""
    centered = points - points.mean(axis=0)
    return [np.ones(len(points)), *np.copysign(1.0, centered).T]


def jackknife_u(values: list[float]) -> float:
    """
    Return the standard uncertainty of a quantity from its values without one group of points each.

    Errors of neighboring points are correlated; therefore compact groups of points are left out
    in turn (delete-a-group jackknife: Shao and Tu 1995, The Jackknife and Bootstrap, 2.3). Few
    groups are corrected by Student's t (GUM G.3). Errors common to all points are not included.
    """
    count = len(values)
    sigma_of_mean = np.sqrt(
        (count - 1) / count * np.sum((np.array(values) - np.mean(values)) ** 2)
    )
    return float(sigma_of_mean * stdtrit(count - 1, 0.95) / GUARD)


def split_groups(points_xyz: Floats, halvings: int) -> Ints:
    """Split points (n, 3) into 2**halvings compact groups of equal size; (n,) group indices."""
    group = np.zeros(len(points_xyz), dtype=np.int64)
    for _ in range(halvings):
        halves = np.zeros_like(group)
        for number in range(int(group.max()) + 1):
            inside = np.flatnonzero(group == number)
            longest = int(np.ptp(points_xyz[inside], axis=0).argmax())
            order = inside[np.argsort(points_xyz[inside, longest], kind='stable')]
            halves[order[len(order) // 2 :]] = 1
        group = 2 * group + halves
    return group
