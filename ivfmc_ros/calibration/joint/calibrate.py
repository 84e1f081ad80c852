# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Cell with covariances from pictures of all kinds: separate steps, then the joint adjustment."""

from dataclasses import dataclass
from dataclasses import replace

import numpy as np

from ivfmc_ros.calibration.joint.adjustment import JointAdjustment
from ivfmc_ros.calibration.joint.adjustment import JointProblem
from ivfmc_ros.calibration.joint.adjustment import residual_values
from ivfmc_ros.calibration.joint.cell_covariance import cell_covariance
from ivfmc_ros.calibration.joint.observability import weak_directions
from ivfmc_ros.calibration.joint.observability import WeakDirection
from ivfmc_ros.calibration.joint.observability import worst_point_sigma
from ivfmc_ros.calibration.joint.observations import JointObservations
from ivfmc_ros.calibration.joint.parameters import JointState
from ivfmc_ros.calibration.joint.parameters import ParameterOrder
from ivfmc_ros.calibration.joint.prior import Prior
from ivfmc_ros.calibration.joint.residuals import PictureResiduals
from ivfmc_ros.calibration.joint.start import free_of
from ivfmc_ros.calibration.joint.start import observations_of
from ivfmc_ros.calibration.joint.start import start_of
from ivfmc_ros.calibration.joint.steps import SeparateSteps
from ivfmc_ros.calibration.turntable.axis_adjustment import relative_size_u
from ivfmc_ros.calibration.turntable.calibrate import x_towards_camera
from ivfmc_ros.calibration.turntable.scale import measured_ratio
from ivfmc_ros.calibration.turntable.scale import ScaleCheck
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.cell import Turntable
from ivfmc_ros.cell.covariance import CellCovariance
from ivfmc_ros.cell.covariance import intrinsic_names
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.errors import CalibrationError
from ivfmc_ros.model import Floats

# Meters between a stripe and where it should lie, from which a picture is refused: a bent board is
# off by 1 mm.
_MAX_STRIPE = 5e-3
# What the pictures never determine, whatever they show.
_NEVER_OBSERVED = (
    'scale: a picture has no length; it comes from the squares of the board alone',
    'zero of the table angle: by convention the first picture of the platter has angle 0',
)


@dataclass(frozen=True, eq=False, kw_only=True)
class JointCalibration:
    """
    Result of a joint calibration.

    cell : with ``covariance``
    adjusted : of the observations
    rms : root mean square of the residuals by kind, pixels or meters: board_px, platter_px,
        board_stripe_m, platter_stripe_m; of the steps before under ``steps_rms``
    worst_point_u : meters, greatest standard uncertainty of a point of the volume, without that
        of the scale
    scale_check : of the length of the target on the platter by lasers and board, without the
        prior; None if no stripe on the platter compares them
    unobserved : what the pictures do not determine, one line each
    """

    cell: Cell
    adjusted: JointAdjustment
    rms: dict[str, float]
    steps_rms: dict[str, float]
    worst_point_u: float
    scale_check: ScaleCheck | None
    unobserved: tuple[str, ...]


def calibrate_jointly(
    steps: SeparateSteps,
    *,
    square: bool = True,
    thickness: float = 0.0,
    scale_u: float | None = None,
    where: str = 'pictures',
) -> JointCalibration:
    """
    Adjust camera, lasers and axis together to all that the separate steps have used.

    thickness : meters, of a board on the platter
    scale_u : relative standard uncertainty of the lengths of the board; None if it is not known
    where : folder of the pictures, for messages
    :raises CalibrationError: the adjustment does not converge
    """
    seen, start = observations_of(steps, thickness), start_of(steps)
    problem = JointProblem(
        observations=seen,
        free=free_of(steps, square=square),
        prior=Prior(seen.platter.target),
    )
    return result_of(problem, start, scale_u=scale_u, where=where)


def result_of(
    problem: JointProblem,
    start: JointState,
    *,
    scale_u: float | None = None,
    where: str = 'pictures',
) -> JointCalibration:
    """Adjust, and return the cell with its covariances; errors as ``calibrate_jointly``."""
    _require_stripes_fit(problem, start, where)
    adjusted = problem.solve(start)
    if not adjusted.converged:
        raise CalibrationError(
            f'{where}: the joint adjustment does not converge; look at the results of the '
            'separate steps (calibrate camera, laser, turntable) for a set of bad pictures'
        )
    checked = _scale_check(problem, adjusted, scale_u)
    adjusted = replace(adjusted, state=_with_x_towards_camera(adjusted.state))
    covariance = cell_covariance(adjusted, scale_u)
    return JointCalibration(
        cell=_cell(adjusted, covariance, problem.observations),
        adjusted=adjusted,
        rms=_rms(problem, adjusted.state, adjusted),
        steps_rms=_rms(problem, start, adjusted),
        worst_point_u=worst_point_sigma(adjusted, covariance, Volume()),
        scale_check=checked,
        unobserved=_unobserved(weak_directions(adjusted), scale_u),
    )


def _scale_check(
    problem: JointProblem, adjusted: JointAdjustment, scale_u: float | None
) -> ScaleCheck | None:
    """Compare the target with the board; the covariance is that of the state before x turns."""
    axis, part = adjusted.state.axis, adjusted.order.axis
    u = relative_size_u(axis, adjusted.covariance[part, part])
    if not u > 0.0 or not problem.observations.platter_stripes:
        return None
    target, prior = problem.observations.platter.target, problem.prior.length_std
    ratio = measured_ratio(target, axis)
    found = ScaleCheck(ratio=ratio, u=ratio * u).without_prior(prior)
    return None if found is None else found.with_length_u(scale_u or 0.0)


def _require_stripes_fit(problem: JointProblem, start: JointState, where: str) -> None:
    """:raises CalibrationError: a stripe lies elsewhere than on its plane and its surface."""
    seen = problem.observations
    found = problem.residuals(start, ParameterOrder.of(start))
    named = [(seen.pictures[number].name, part) for number, part in found.board_stripes]
    stripes = [one.name for one in seen.platter_stripes]
    named += list(zip(stripes, found.platter_stripes, strict=True))
    off = {name: float(np.median(np.abs(part.values))) for name, part in named}
    wrong = sorted((name for name in off if off[name] > _MAX_STRIPE), key=lambda n: -off[n])
    if wrong:
        raise CalibrationError(
            f'{where}: {wrong[0]}: its stripe is {off[wrong[0]] * 1e3:.1f} mm off the laser plane '
            f'or the platter, as are {len(wrong) - 1} more; sort out pictures in which the stripe '
            'lies on something else, or is of another laser'
        )


def _with_x_towards_camera(state: JointState) -> JointState:
    return replace(state, axis=x_towards_camera(state.axis))


def _unobserved(weak: tuple[WeakDirection, ...], scale_u: float | None) -> tuple[str, ...]:
    scale, zero = _NEVER_OBSERVED
    known = 'of unknown uncertainty (--board-u)' if scale_u is None else f'u = {scale_u:.2%}'
    return (f'{scale}, {known}', zero, *map(str, weak))


def _rms(problem: JointProblem, state: JointState, adjusted: JointAdjustment) -> dict[str, float]:
    found = problem.residuals(state, adjusted.order)
    corners = {'board_px': found.boards, 'platter_px': found.platter}
    stripes = {
        'board_stripe_m': [part for _, part in found.board_stripes],
        'platter_stripe_m': list(found.platter_stripes),
    }
    rms = {name: np.sqrt(2.0) * _root_mean_square(list(parts)) for name, parts in corners.items()}
    rms |= {name: _root_mean_square(parts) for name, parts in stripes.items() if parts}
    return {name: float(value) for name, value in rms.items()}


def _root_mean_square(parts: list[PictureResiduals]) -> float:
    return float(np.sqrt(np.mean(residual_values(parts) ** 2)))


def _cell(adjusted: JointAdjustment, covariance: CellCovariance, seen: JointObservations) -> Cell:
    state, residuals = adjusted.state, adjusted.residuals
    camera = replace(state.camera, covariance=covariance.block(intrinsic_names(covariance)))
    lasers = []
    for index, laser in enumerate(state.lasers):
        own = [
            part.values
            for number, part in residuals.board_stripes
            if _laser_of(seen, number) == index
        ]
        lasers.append(_laser(laser, np.concatenate(own), covariance))
    return Cell(
        camera=camera,
        turntable=_turntable(adjusted, covariance, seen, camera),
        lasers=tuple(lasers),
        covariance=covariance,
    )


def _laser_of(seen: JointObservations, number: int) -> int:
    stripe = seen.pictures[number].stripe
    return -1 if stripe is None else stripe.laser


def _laser(laser: LaserPlane, residuals: Floats, covariance: CellCovariance) -> LaserPlane:
    names = [f'{laser.name}.{part}' for part in ('nx', 'ny', 'nz', 'd')]
    return replace(
        laser,
        residual_rms=float(np.sqrt(np.mean(residuals**2))),
        covariance=covariance.block_for_known(names, intrinsic_names(covariance)),
    )


def _turntable(
    adjusted: JointAdjustment,
    covariance: CellCovariance,
    seen: JointObservations,
    camera: Camera,
) -> Turntable:
    axis = adjusted.state.axis
    off = np.concatenate(
        [np.linalg.norm(part.values.reshape(-1, 2), axis=1) for part in adjusted.residuals.platter]
    )
    depth = float(np.median(axis.corners_in_camera(seen.platter.corners)[:, 2]))
    focal = float(camera.K[[0, 1], [0, 1]].mean())
    return Turntable(
        camera_from_base=axis.camera_from_base,
        residual_rms=float(np.sqrt(np.mean(off**2))) * depth / focal,
        covariance=covariance.block_for_known(
            covariance.parameters[-6:], intrinsic_names(covariance)
        ),
    )
