# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Acceptance test of a cell: errors of a calibrated artifact, their uncertainty, and verdicts.

Characteristics after VDI/VDE 2634-3 and ISO 10360-13; verdicts after ISO 14253-1 with the
uncertainty of the test value (ISO 14253-5), which is that of the artifact and its temperature.
"""

from collections.abc import Callable
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import field

import numpy as np

from ivfmc_ros.acceptance.artifact import Artifact
from ivfmc_ros.acceptance.find_planes import find_plate
from ivfmc_ros.acceptance.find_planes import find_step
from ivfmc_ros.acceptance.find_spheres import find_spheres
from ivfmc_ros.acceptance.find_spheres import FoundSphere
from ivfmc_ros.acceptance.points import COVERAGE_FACTOR
from ivfmc_ros.acceptance.points import MeasuredPoints
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.scale import scale_u
from ivfmc_ros.inspection.conditions import Conditions
from ivfmc_ros.inspection.features import fit
from ivfmc_ros.inspection.uncertainty import calibration_modes
from ivfmc_ros.inspection.uncertainty import CalibrationModes
from ivfmc_ros.inspection.verdict import FAIL
from ivfmc_ros.inspection.verdict import GUARD
from ivfmc_ros.inspection.verdict import NOT_DECIDED
from ivfmc_ros.inspection.verdict import PASS
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.validation import require_in_range

# Share of the points that a form error may leave out (VDI/VDE 2634-3: at most 3 per mille).
_DISCARDED = 0.003
# Share of the points that a dispersion holds (ISO 10360-13, D95 %).
_DISPERSION = 0.95
# Points per sphere or plane by which the uncertainty of the calibration is propagated.
_MAX_POINTS = 1500


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Maximum permissible errors, meters: probing form and size, distance, flatness, step."""

    form: float = 60e-6
    size: float = 30e-6
    distance: float = 30e-6
    flatness: float = 60e-6
    step: float = 30e-6

    def __post_init__(self) -> None:
        for name in ('form', 'size', 'distance', 'flatness', 'step'):
            require_in_range(f'limit: {name}', getattr(self, name), 0.0, 0.1, 'm', open_low=True)

    def max_u(self, artifact: Artifact) -> float:
        """Return the greatest U (meters, k = 2) of a point by which an artifact is judged."""
        if artifact.spheres:
            return self.form
        return self.flatness if artifact.kind == 'plate' else self.step


@dataclass(frozen=True, kw_only=True)
class Characteristic:
    """
    One error of the test. Lengths are meters.

    name, symbol : as in the standards
    value : the error, or the form; ``measured`` and ``nominal`` the lengths it comes from, or None
    limit : maximum permissible error
    u_test : standard uncertainty of the test value
    u_cell : what the calibration of the cell states for it, 1 sigma; None without covariances
    """

    name: str
    symbol: str
    value: float
    limit: float
    u_test: float
    u_cell: float | None = None
    measured: float | None = None
    nominal: float | None = None

    @property
    def verdict(self) -> str:
        """Pass, fail or not decided (ISO 14253-1)."""
        guard = GUARD * self.u_test
        if abs(self.value) + guard <= self.limit:
            return PASS
        return FAIL if abs(self.value) - guard > self.limit else NOT_DECIDED

    @property
    def normalized_error(self) -> float | None:
        """|error| / U with U of cell and test value, k = 2; None where both are 0 or unknown."""
        if self.u_cell is None or self.nominal is None:
            return None
        expanded = COVERAGE_FACTOR * float(np.hypot(self.u_cell, self.u_test))
        return abs(self.value) / expanded if expanded > 0 else None


@dataclass(frozen=True, eq=False, kw_only=True)
class Check:
    """
    Result of an acceptance test.

    points_xyz, deviations : (n, 3) and (n,) meters, of the points of spheres or planes
    coverage : share of the surface of each sphere that was measured
    left_out : share of the measured vertices whose own U is too large to judge by
    """

    artifact: Artifact
    characteristics: tuple[Characteristic, ...]
    points_xyz: Floats
    deviations: Floats
    coverage: tuple[float, ...] = ()
    left_out: float = 0.0
    conditions: Conditions = field(default_factory=Conditions)

    @property
    def verdict(self) -> str:
        """Fail if any fails, pass if all pass, otherwise not decided."""
        verdicts = {one.verdict for one in self.characteristics}
        if FAIL in verdicts:
            return FAIL
        return PASS if verdicts == {PASS} else NOT_DECIDED


@dataclass(frozen=True, eq=False, kw_only=True)
class _Scan:
    points: Floats
    normals: Floats
    systematic: Floats | None
    left_out: float
    artifact: Artifact
    limits: Limits
    conditions: Conditions
    cell: Cell | None

    def u_test(self, length: float) -> float:
        own = length * self.conditions.temperature_relative_u
        return float(np.hypot(self.artifact.u, own))

    def u_cell(
        self, rows: Sequence[Ints], measure: Callable[[list[Floats]], float], length: float
    ) -> float | None:
        """Return what the calibration states for a quantity of several groups of points."""
        if self.cell is None:
            return None
        chosen = [group[:: max(1, len(group) // _MAX_POINTS)] for group in rows]
        joined = np.concatenate(chosen)
        ends = np.cumsum([len(group) for group in chosen])[:-1]
        modes = calibration_modes(self.cell, self.points[joined], self.normals[joined])
        if not len(modes.shifts):
            return None
        u = CalibrationModes(shifts=modes.shifts).propagate(
            lambda xyz: measure(np.split(xyz, ends)), self.points[joined]
        )
        relative_u = scale_u(self.cell.notes, self.cell.covariance)
        return float(np.hypot(u, length * (relative_u or 0.0)))

    def u_size(self, sphere: FoundSphere) -> float | None:
        """
        Return what calibration and points state for the diameter of a sphere.

        All points of a sphere may be off to the same side by what their sheet's thickness leaves.
        """
        u = self.u_cell(
            [sphere.rows], lambda xyz: fit('sphere', xyz[0]).diameter, self.artifact.diameter
        )
        if u is None or self.systematic is None:
            return u
        shared = 2.0 * float(self.systematic[sphere.rows].mean())
        return float(np.hypot(u, shared)) if np.isfinite(shared) else None


def check_artifact(
    artifact: Artifact,
    measured: MeasuredPoints,
    *,
    limits: Limits | None = None,
    conditions: Conditions | None = None,
    cell: Cell | None = None,
) -> Check:
    """
    Measure an artifact in a scan and judge the cell.

    measured : the points of the scan
    conditions : temperature and expansion of the artifact
    cell : whose covariances state the uncertainty to be proved; None if unknown
    :raises GeometryError: the scan does not show the artifact
    """
    conditions = conditions or Conditions()
    scan = _Scan(
        points=measured.points_xyz * conditions.to_reference,
        normals=measured.normals,
        systematic=measured.systematic,
        left_out=measured.left_out,
        artifact=artifact,
        limits=limits or Limits(),
        conditions=conditions,
        cell=cell,
    )
    if artifact.spheres:
        return _check_spheres(scan)
    return _check_plate(scan) if artifact.kind == 'plate' else _check_step(scan)


def _check_spheres(scan: _Scan) -> Check:
    found = find_spheres(scan.artifact, scan.points, scan.normals)
    characteristics: list[Characteristic] = []
    for number, sphere in enumerate(found, start=1):
        suffix = f', sphere {number}' if len(found) > 1 else ''
        characteristics += _sphere_errors(scan, sphere, suffix)
    if len(found) == 2:
        characteristics.append(_distance_error(scan, found))
    rows = np.concatenate([sphere.rows for sphere in found])
    return Check(
        artifact=scan.artifact,
        characteristics=tuple(characteristics),
        points_xyz=scan.points[rows],
        deviations=np.concatenate([_radial(scan, sphere) for sphere in found]),
        coverage=tuple(sphere.coverage for sphere in found),
        left_out=scan.left_out,
        conditions=scan.conditions,
    )


def _sphere_errors(scan: _Scan, sphere: FoundSphere, suffix: str) -> list[Characteristic]:
    radial, diameter = _radial(scan, sphere), scan.artifact.diameter
    size = sphere.diameter - diameter
    return [
        Characteristic(
            name=f'probing form error{suffix}',
            symbol='PF (P_Form.Sph)',
            value=form_error(radial),
            limit=scan.limits.form,
            u_test=scan.u_test(0.0),
            u_cell=scan.u_cell([sphere.rows], lambda xyz: _sphere_form(xyz[0]), 0.0),
        ),
        Characteristic(
            name=f'probing dispersion, 95 %{suffix}',
            symbol='PD (P_Form.Sph.D95%)',
            value=dispersion(radial),
            limit=scan.limits.form,
            u_test=scan.u_test(0.0),
        ),
        Characteristic(
            name=f'probing size error{suffix}',
            symbol='PS (P_Size.Sph)',
            value=size,
            limit=scan.limits.size,
            u_test=scan.u_test(diameter),
            u_cell=scan.u_size(sphere),
            measured=sphere.diameter,
            nominal=diameter,
        ),
    ]


def _sphere_form(points: Floats) -> float:
    feature = fit('sphere', points)
    arms = np.linalg.norm(points - feature.center_xyz, axis=1)
    return form_error(arms - 0.5 * feature.diameter)


def _distance_error(scan: _Scan, found: Sequence[FoundSphere]) -> Characteristic:
    first, second = found
    measured = float(np.linalg.norm(second.center_xyz - first.center_xyz))
    nominal = scan.artifact.length

    def distance(groups: list[Floats]) -> float:
        centers = [fit('sphere', xyz).center_xyz for xyz in groups]
        return float(np.linalg.norm(centers[1] - centers[0]))

    return Characteristic(
        name='sphere-distance error',
        symbol='SD (D_CC)',
        value=measured - nominal,
        limit=scan.limits.distance,
        u_test=scan.u_test(nominal),
        u_cell=scan.u_cell([first.rows, second.rows], distance, nominal),
        measured=measured,
        nominal=nominal,
    )


def _radial(scan: _Scan, sphere: FoundSphere) -> Floats:
    arms = np.linalg.norm(scan.points[sphere.rows] - sphere.center_xyz, axis=1)
    return np.asarray(arms - 0.5 * sphere.diameter)


def _check_plate(scan: _Scan) -> Check:
    plane = find_plate(scan.points, scan.normals)
    heights = plane.heights(scan.points[plane.rows])

    def flatness(groups: list[Floats]) -> float:
        feature = fit('plane', groups[0])
        return form_error((groups[0] - feature.center_xyz) @ feature.axis)

    flat = Characteristic(
        name='flatness error',
        symbol='F (E_Form.Pla)',
        value=form_error(heights),
        limit=scan.limits.flatness,
        u_test=scan.u_test(0.0),
        u_cell=scan.u_cell([plane.rows], flatness, 0.0),
    )
    return Check(
        artifact=scan.artifact,
        characteristics=(flat,),
        points_xyz=scan.points[plane.rows],
        deviations=heights,
        left_out=scan.left_out,
        conditions=scan.conditions,
    )


def _check_step(scan: _Scan) -> Check:
    nominal = scan.artifact.length
    first, second = find_step(scan.points, scan.normals, nominal)

    def height(groups: list[Floats]) -> float:
        feature = fit('plane', groups[0])
        return abs(float(((groups[1] - feature.center_xyz) @ feature.axis).mean()))

    measured = height([scan.points[first.rows], scan.points[second.rows]])
    step = Characteristic(
        name='step height error',
        symbol='E_Step',
        value=measured - nominal,
        limit=scan.limits.step,
        u_test=scan.u_test(nominal),
        u_cell=scan.u_cell([first.rows, second.rows], height, nominal),
        measured=measured,
        nominal=nominal,
    )
    rows = np.concatenate([first.rows, second.rows])
    off = [plane.heights(scan.points[plane.rows]) for plane in (first, second)]
    return Check(
        artifact=scan.artifact,
        characteristics=(step,),
        points_xyz=scan.points[rows],
        deviations=np.concatenate(off),
        left_out=scan.left_out,
        conditions=scan.conditions,
    )


def dispersion(deviations: Floats) -> float:
    """Return the smallest width that holds 95 % of the deviations (n,) (ISO 10360-13, D95 %)."""
    ordered = np.sort(deviations)
    count = int(np.ceil(_DISPERSION * len(ordered)))
    return float((ordered[count - 1 :] - ordered[: len(ordered) - count + 1]).min())


def form_error(deviations: Floats) -> float:
    """
    Return the range of deviations (n,) from a fitted shape, without 3 per mille of the points.

    VDI/VDE 2634-3 lets a test leave out so many; they are the ones farthest from the shape.
    """
    left_out = int(_DISCARDED * len(deviations))
    order = np.argsort(np.abs(deviations - np.median(deviations)))
    return float(np.ptp(deviations[order[: len(deviations) - left_out]]))
