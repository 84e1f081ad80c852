# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Weighted normal equations with board poses and table angles eliminated (Schur complement).

Each picture has parameters of its own (six of a board pose, or one table angle), so that the
matrix is an arrow: a dense corner of the common parameters, and one small block a picture.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ivfmc_ros.calibration.joint.residuals import PictureResiduals
from ivfmc_ros.calibration.joint.weights import Weights
from ivfmc_ros.model import Floats


@dataclass(frozen=True, eq=False, kw_only=True)
class Weighted:
    """Residuals with their weights."""

    residuals: PictureResiduals
    weights: Weights

    @property
    def cost(self) -> float:
        """Weighted sum of squares."""
        values = self.residuals.values
        return float(values @ self.weights.apply(values[:, None])[:, 0])


@dataclass(frozen=True, eq=False, kw_only=True)
class PictureBlock:
    """
    Normal equations of one picture.

    cc, cl, ll : (c, c), (c, l), (l, l); gradient_c, gradient_l : (c,), (l,)
    """

    cc: Floats
    cl: Floats
    ll: Floats
    gradient_c: Floats
    gradient_l: Floats

    @classmethod
    def of(cls, parts: Sequence[Weighted], expansion: Floats) -> 'PictureBlock':
        """Return the sum over the residuals of one picture; expansion : (count, c)."""
        sums: list[Floats] = []
        for part in parts:
            common, local = part.residuals.common @ expansion, part.residuals.local
            columns = np.hstack([common, local, part.residuals.values[:, None]])
            sums.append(columns.T @ part.weights.apply(columns))
        total, c = np.sum(sums, axis=0), expansion.shape[1]
        return cls(
            cc=total[:c, :c],
            cl=total[:c, c:-1],
            ll=total[c:-1, c:-1],
            gradient_c=total[:c, -1],
            gradient_l=total[c:-1, -1],
        )

    def reduced(self, damping: float = 0.0) -> tuple[Floats, Floats]:
        """Eliminate the picture's own parameters: (c, c) matrix and (c,) gradient."""
        gain = self._gain(damping)
        return self.cc - self.cl @ gain, self.gradient_c - gain.T @ self.gradient_l

    def local_step(self, common: Floats, damping: float) -> Floats:
        """Return the (l,) step of the picture's own parameters."""
        right = self.gradient_l - self.cl.T @ common
        return np.asarray(np.linalg.solve(self._damped(damping), right))

    def _gain(self, damping: float) -> Floats:
        return np.asarray(np.linalg.solve(self._damped(damping), self.cl.T))

    def _damped(self, damping: float) -> Floats:
        return self.ll + damping * np.diag(np.diag(self.ll))


@dataclass(frozen=True, eq=False, kw_only=True)
class BundleEquations:
    """
    Normal equations of all pictures, and of what is known before.

    blocks : one a picture
    prior : (c, c) and (c,), of parameters whose values are known before
    """

    blocks: tuple[PictureBlock, ...]
    prior: tuple[Floats, Floats]

    def step(self, damping: float) -> tuple[Floats, list[Floats]]:
        """Return the damped step of the common parameters, (c,), and of each picture's own."""
        reduced = [block.reduced(damping) for block in self.blocks]
        matrix = self.prior[0] + np.sum([part[0] for part in reduced], axis=0)
        matrix = matrix + damping * np.diag(np.diag(matrix))
        right = self.prior[1] + np.sum([part[1] for part in reduced], axis=0)
        common = scaled_solve(matrix, right)
        return common, [block.local_step(common, damping) for block in self.blocks]

    def information(self) -> tuple[Floats, Floats]:
        """Return the (c, c) information of the common parameters, and the (n, c) scores."""
        reduced = [block.reduced() for block in self.blocks]
        matrix = self.prior[0] + np.sum([part[0] for part in reduced], axis=0)
        return np.asarray(matrix), np.array([part[1] for part in reduced])


def scaled_solve(matrix: Floats, right: Floats) -> Floats:
    """Solve a symmetric system whose parameters differ by orders of magnitude (least norm)."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix / np.outer(scale, scale)
    return np.asarray(np.linalg.lstsq(scaled, right / scale, rcond=1e-12)[0] / scale)


def scaled_inverse(matrix: Floats) -> Floats:
    """Return the inverse of a positive definite matrix, scaled to a unit diagonal before."""
    scale = np.sqrt(np.diag(matrix))
    inverse = np.linalg.inv(matrix / np.outer(scale, scale))
    return np.asarray(0.5 * (inverse + inverse.T) / np.outer(scale, scale))
