# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Joint adjustment of a cell to all pictures (Levenberg-Marquardt, Huber weights).

Bundle adjustment (Triggs et al. 2000) with two kinds of observations more: stripe points lie on
their laser plane and on a board of unknown pose, or on the platter. The covariance treats each
picture as one observation (cluster-robust sandwich, Liang & Zeger 1986).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ivfmc_ros.calibration.joint.normal_equations import BundleEquations
from ivfmc_ros.calibration.joint.normal_equations import PictureBlock
from ivfmc_ros.calibration.joint.normal_equations import scaled_inverse
from ivfmc_ros.calibration.joint.normal_equations import Weighted
from ivfmc_ros.calibration.joint.observations import JointObservations
from ivfmc_ros.calibration.joint.parameters import apply_step
from ivfmc_ros.calibration.joint.parameters import FreeJointParameters
from ivfmc_ros.calibration.joint.parameters import JointState
from ivfmc_ros.calibration.joint.parameters import ParameterOrder
from ivfmc_ros.calibration.joint.parameters import vague_sigma
from ivfmc_ros.calibration.joint.prior import Prior
from ivfmc_ros.calibration.joint.residuals import board_corner_residuals
from ivfmc_ros.calibration.joint.residuals import board_stripe_residuals
from ivfmc_ros.calibration.joint.residuals import PictureResiduals
from ivfmc_ros.calibration.joint.residuals import platter_corner_residuals
from ivfmc_ros.calibration.joint.residuals import platter_stripe_residuals
from ivfmc_ros.calibration.joint.weights import corner_sigma
from ivfmc_ros.calibration.joint.weights import corner_weights
from ivfmc_ros.calibration.joint.weights import NoiseLevels
from ivfmc_ros.calibration.joint.weights import stripe_sigma
from ivfmc_ros.calibration.joint.weights import stripe_weights
from ivfmc_ros.calibration.turntable.axis_adjustment import correlation_inflation
from ivfmc_ros.errors import CellError
from ivfmc_ros.model import Floats

_MAX_ITERATIONS = 40
# Relative decrease of the cost at which the iteration stops. Weights and noise levels change the
# cost by more than a smaller one would.
_CONVERGED = 1e-7
_MAX_DAMPING = 1e8
# Pictures per common parameter from which the cluster-robust covariance is used: its rank is at
# most the number of pictures.
_MIN_PICTURES_PER_PARAMETER = 1.5


@dataclass(frozen=True, eq=False, kw_only=True)
class JointResiduals:
    """
    Residuals of all pictures at one state.

    boards, board_stripes : in the order of the pictures; the second with the picture's index
    platter : of each picture of the target on the platter
    platter_stripes : one a picture
    """

    boards: tuple[PictureResiduals, ...]
    board_stripes: tuple[tuple[int, PictureResiduals], ...]
    platter: tuple[PictureResiduals, ...]
    platter_stripes: tuple[PictureResiduals, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class JointAdjustment:
    """
    Result of the adjustment.

    covariance : (count, count) of the common parameters, cluster-robust; 0 for fixed ones
    information : (free, free) of the free parameters, by their weights
    expansion : (count, free) from the free to all common parameters
    converged : whether the iteration stopped before its greatest number of steps
    """

    state: JointState
    order: ParameterOrder
    covariance: Floats
    information: Floats
    expansion: Floats
    residuals: JointResiduals
    noise: NoiseLevels
    converged: bool


@dataclass(frozen=True, eq=False, kw_only=True)
class _Equations:
    normal: BundleEquations
    weights: tuple[tuple[Weighted, ...], ...]
    prior_cost: float
    residuals: JointResiduals
    noise: NoiseLevels

    @property
    def cost(self) -> float:
        return self.prior_cost + sum(part.cost for parts in self.weights for part in parts)


@dataclass(frozen=True, eq=False, kw_only=True)
class JointProblem:
    """
    Observations, free parameters and what is known before.

    free : parameters to estimate
    prior : of the scale of the target on the platter and its corners
    """

    observations: JointObservations
    free: FreeJointParameters
    prior: Prior

    def residuals(self, state: JointState, order: ParameterOrder) -> JointResiduals:
        """Return the residuals of all pictures at a state."""
        seen = self.observations
        posed = list(zip(seen.pictures, state.board_poses, strict=True))
        return JointResiduals(
            boards=tuple(
                board_corner_residuals(state, order, seen.board, picture, pose)
                for picture, pose in posed
            ),
            board_stripes=tuple(
                (number, board_stripe_residuals(state, order, picture.stripe, pose))
                for number, (picture, pose) in enumerate(posed)
                if picture.stripe is not None
            ),
            platter=_by_picture(platter_corner_residuals(state, order, seen.platter), seen),
            platter_stripes=tuple(
                platter_stripe_residuals(state, order, one.stripe) for one in seen.platter_stripes
            ),
        )

    def noise(self, found: JointResiduals) -> NoiseLevels:
        """Return the noise levels that residuals show."""
        corners = self.observations.platter.corners
        pixels = np.concatenate([part.values for part in found.platter]).reshape(-1, 2)
        order = np.argsort(corners.picture, kind='stable')
        inflation = correlation_inflation(corners, pixels[np.argsort(order, kind='stable')])
        return NoiseLevels(
            board=corner_sigma(found.boards),
            platter=inflation * corner_sigma(found.platter),
            board_stripe=stripe_sigma([part for _, part in found.board_stripes]),
            platter_stripe=stripe_sigma(found.platter_stripes),
        )

    def solve(self, start: JointState) -> JointAdjustment:
        """Minimize the weighted residuals from a start."""
        order = ParameterOrder.of(start)
        state, equations, damping = start, self._equations(start, order), 1e-4
        converged = False
        for _ in range(_MAX_ITERATIONS):
            trial = self._trial(state, order, equations, damping)
            gain = (
                -np.inf if trial is None else equations.cost - self._cost(trial, order, equations)
            )
            if trial is None or not gain >= 0:
                damping *= 10
                if damping > _MAX_DAMPING:
                    converged = True
                    break
                continue
            before = equations.cost
            state, equations = trial, self._equations(trial, order)
            damping = max(damping / 10, 1e-12)
            if gain <= _CONVERGED * before:
                converged = True
                break
        return self._result(state, order, equations, converged)

    def _trial(
        self, state: JointState, order: ParameterOrder, equations: _Equations, damping: float
    ) -> JointState | None:
        """Return the state after a damped step; None if no camera or laser is like that."""
        expansion = self.free.expansion(order, state)
        common, local = equations.normal.step(damping)
        boards = len(self.observations.pictures)
        angles = np.zeros(len(state.axis.angles))
        angles[:] = np.concatenate([part for part in local[boards:] if len(part)])
        try:
            return apply_step(state, order, expansion @ common, np.array(local[:boards]), angles)
        except CellError:
            return None

    def _equations(self, state: JointState, order: ParameterOrder) -> _Equations:
        found = self.residuals(state, order)
        noise = self.noise(found)
        expansion = self.free.expansion(order, state)
        weights = tuple(_weighted(found, noise))
        prior = self.prior.equations(state, order, expansion)
        blocks = tuple(PictureBlock.of(parts, expansion) for parts in weights)
        return _Equations(
            normal=BundleEquations(blocks=blocks, prior=prior),
            weights=weights,
            prior_cost=self.prior.cost(state),
            residuals=found,
            noise=noise,
        )

    def _cost(self, state: JointState, order: ParameterOrder, equations: _Equations) -> float:
        """Return the cost with the weights of another state, so that both can be compared."""
        found = tuple(_grouped(self.residuals(state, order)))
        total = self.prior.cost(state)
        for parts, seen in zip(equations.weights, found, strict=True):
            for part, residuals in zip(parts, seen, strict=True):
                total += Weighted(residuals=residuals, weights=part.weights).cost
        return total

    def _result(
        self, state: JointState, order: ParameterOrder, equations: _Equations, converged: bool
    ) -> JointAdjustment:
        expansion = self.free.expansion(order, state)
        information, scores = equations.normal.information()
        before = equations.normal.prior[0] + _vague_prior(order, expansion)
        bread = scaled_inverse(information + before - equations.normal.prior[0])
        covariance = _sandwich(bread, scores, before)
        return JointAdjustment(
            state=state,
            order=order,
            covariance=expansion @ covariance @ expansion.T,
            information=information,
            expansion=expansion,
            residuals=equations.residuals,
            noise=equations.noise,
            converged=converged,
        )


def _vague_prior(order: ParameterOrder, expansion: Floats) -> Floats:
    """
    Return (free, free) information of what any cell of this kind has.

    It leaves a parameter that no picture determines with its whole standard deviation, where the
    pseudo-inverse would state 0. On others it has no effect.
    """
    sigma = vague_sigma(order)
    free = np.array([sigma[int(np.argmax(column))] for column in np.abs(expansion.T)])
    return np.diag(1.0 / free**2)


def _sandwich(bread: Floats, scores: Floats, before: Floats) -> Floats:
    """
    Return the cluster-robust covariance, or that of the model where it is greater on average.

    before : (free, free) information that comes from no picture
    """
    pictures, parameters = scores.shape
    if pictures < _MIN_PICTURES_PER_PARAMETER * parameters:
        # too few to tell the errors of one direction from those of another: one factor for all
        dispersion = float(np.mean(np.einsum('np,pq,nq->n', scores, bread, scores)))
        return np.asarray(bread * max(1.0, dispersion * pictures / parameters))
    correction = pictures / (pictures - parameters)
    sandwich = bread @ (scores.T @ scores * correction + before) @ bread
    # few pictures give a sandwich that is too small: the mean ratio to the model is at least 1
    scale = np.sqrt(np.maximum(np.diag(bread), 1e-300))
    ratio = float(np.mean(np.diag(sandwich) / scale**2))
    return np.asarray(sandwich if ratio >= 1.0 else bread)


def _by_picture(found: PictureResiduals, seen: JointObservations) -> tuple[PictureResiduals, ...]:
    picture = np.repeat(seen.platter.corners.picture, 2)
    parts = []
    for number in range(len(seen.platter.names)):
        rows = picture == number
        parts.append(
            PictureResiduals(
                values=found.values[rows],
                common=found.common[rows],
                local=found.local[rows],
                pixel_sigma=found.pixel_sigma[rows],
                shapes=found.shapes[rows],
            )
        )
    return tuple(parts)


def _grouped(found: JointResiduals) -> list[list[PictureResiduals]]:
    """Return the residuals by picture: boards, target on the platter, stripes on the platter."""
    boards = [[part] for part in found.boards]
    for number, stripe in found.board_stripes:
        boards[number].append(stripe)
    return [
        *boards,
        *([part] for part in found.platter),
        *([part] for part in found.platter_stripes),
    ]


def _weighted(found: JointResiduals, noise: NoiseLevels) -> list[tuple[Weighted, ...]]:
    boards, platter = len(found.boards), len(found.platter)
    blocks = []
    for number, parts in enumerate(_grouped(found)):
        weighted = []
        for part in parts:
            if part.shapes.shape[1]:
                sigma = noise.board_stripe if number < boards else noise.platter_stripe
                weights = stripe_weights(part, sigma)
            else:
                sigma = noise.board if number < boards else noise.platter
                weights = corner_weights(part, sigma)
            weighted.append(Weighted(residuals=part, weights=weights))
        blocks.append(tuple(weighted))
    if len(blocks) != boards + platter + len(found.platter_stripes):
        raise ValueError('residuals do not match their pictures')
    return blocks


def residual_values(parts: Sequence[PictureResiduals]) -> Floats:
    """Return the values of several residuals in one array."""
    return np.concatenate([part.values for part in parts]) if parts else np.empty(0)
