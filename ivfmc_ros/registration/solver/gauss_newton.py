# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
All views at once: every overlap pulls, coarse to fine, until nothing moves any more.

Gauss-Newton on point-to-plane distances (Chen and Medioni 1992) in their symmetric form
(Rusinkiewicz 2019), with robust weights. The unknowns are six a view and those of the cell.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from itertools import permutations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from ivfmc_ros.cell import transforms
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.registration.solver.correspondences import match
from ivfmc_ros.registration.solver.correspondences import Pairs
from ivfmc_ros.registration.solver.correspondences import reach_of
from ivfmc_ros.registration.solver.degeneracy import Solution
from ivfmc_ros.registration.solver.degeneracy import solve
from ivfmc_ros.registration.solver.normal_equations import assemble
from ivfmc_ros.registration.solver.normal_equations import DOF
from ivfmc_ros.registration.solver.normal_equations import Noise
from ivfmc_ros.registration.solver.normal_equations import robust_scale
from ivfmc_ros.registration.solver.normal_equations import Slopes
from ivfmc_ros.registration.solver.normal_equations import System
from ivfmc_ros.registration.solver.schedule import coarse_reaches
from ivfmc_ros.registration.solver.schedule import Pace
from ivfmc_ros.registration.solver.schedule import THOROUGH
from ivfmc_ros.registration.solver.surfels import Patches

_LEAST_PAIRS = 30
# While it is coarse, a view speaks through about so many patches.
_COARSE = 1500
# Weights fall to a quarter at the reach over this: what few features tell must not be taken for
# outliers as long as it may be the error that is looked for.
_WIDTHS = 3.0
# The last reach is so many sigmas of the residuals.
_LAST = 6.0
# Whole regions are displaced by this share of a patch's sigma: quadrics are not the surface.
_LASTING = 0.3


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """
    What is to be brought together.

    patches : of each view, frame ``turntable``; slopes : None where the cell is known
    edge : metres, between patches
    origin : (C,) the cell's values with which the patches were made; None for zeros
    lasting : share of a patch's sigma by which whole regions are displaced
    """

    patches: Sequence[Patches]
    slopes: Slopes | None
    edge: float
    origin: Floats | None = None
    lasting: float = _LASTING

    @property
    def cell_unknowns(self) -> int:
        """How many unknowns the cell has."""
        return self.slopes.unknowns if self.slopes else 0

    def moved(self, cell_values: Floats) -> Sequence[Patches]:
        """Return the patches of the cell changed by (C,) values, to first order."""
        change = cell_values if self.origin is None else cell_values - self.origin
        if self.slopes is None or not change.any():
            return self.patches
        return [
            patches.moved(np.einsum('ncd,c->nd', slopes, change))
            for patches, slopes in zip(self.patches, self.slopes.of_patches, strict=True)
        ]


@dataclass(frozen=True, eq=False, kw_only=True)
class Joint:
    """
    The joint solution.

    poses : (views, 4, 4) turntable_from_view; cell_values : (C,)
    solution, system : of the last step
    converged : nothing moved any more
    """

    poses: Floats
    cell_values: Floats
    solution: Solution
    system: System
    converged: bool


def solve_jointly(
    scene: Scene,
    prior_root: Floats,
    reach: float,
    start: Joint | None = None,
    pace: Pace = THOROUGH,
) -> Joint:
    """
    Find all poses, and what the data tell of the cell.

    prior_root : (6 views + C,) squared, a matrix L with the prior's covariance L L'; rows of 0
        for what shall stay
    reach : metres, by how much views may be apart at first
    start : go on from there, fine only
    """
    views = len(scene.patches)
    values = np.zeros(len(prior_root)) if start is None else _values(start)
    pairs = list(combinations(range(views), 2))
    steps = _Steps(scene=scene, prior_root=prior_root, size=_size(scene.patches), pace=pace)
    if start is None:
        for gap in coarse_reaches(reach, scene.edge):
            values, pairs = steps.coarse(values, pairs, gap)
    return steps.fine(values, pairs, reach)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Steps:
    scene: Scene
    prior_root: Floats
    size: float
    pace: Pace

    def coarse(
        self, values: Floats, pairs: list[tuple[int, int]], gap: float
    ) -> tuple[Floats, list[tuple[int, int]]]:
        for _ in range(self.pace.coarse):
            blocks = self._blocks(values, pairs, gap, coarse=True)
            pairs = [(block.a, block.b) for block in blocks]
            _, solution = self._solved(blocks, values, gap, None)
            moved, values = self._moved(values, solution), _stepped(values, solution, self._views)
            if moved < 0.05 * gap:
                break
        return values, pairs

    def fine(self, values: Floats, pairs: list[tuple[int, int]], reach: float) -> Joint:
        last = self._last_reach(values, pairs, reach)
        between = coarse_reaches(min(reach, self.scene.edge), last) if self.pace.middle else []
        for gap in between:
            values, _, _, _ = self._settled(values, pairs, gap, self.pace.middle, None)
        values, system, solution, moved = self._settled(
            values, pairs, last, self.pace.fine, self.scene.edge
        )
        return Joint(
            poses=_poses(values, self._views),
            cell_values=values[DOF * self._views :],
            solution=solution,
            system=system,
            converged=bool(moved < 1.0),
        )

    def _settled(
        self,
        values: Floats,
        pairs: list[tuple[int, int]],
        gap: float,
        steps: int,
        edge: float | None,
    ) -> tuple[Floats, System, Solution, float]:
        """Repeat steps with one reach until nothing moves; the last is how far, in sigmas."""
        fixed: Floats | None = None
        for step in range(steps):
            blocks = self._blocks(values, pairs, gap, coarse=False)
            system, solution = self._solved(blocks, values, gap, edge, fixed)
            # a direction that is just seen, and just not seen, would move to and fro for ever
            fixed = solution.directions if step >= self.pace.middle else None
            moved = self._moved(values, solution) / self._noise()
            values = _stepped(values, solution, self._views)
            if moved < self.pace.still:
                break
        return values, system, solution, moved

    @property
    def _views(self) -> int:
        return len(self.scene.patches)

    def _noise(self) -> float:
        sigma = [patches.sigma for patches in self.scene.patches if len(patches)]
        return float(np.median(np.concatenate(sigma))) if sigma else 1e-5

    def _last_reach(self, values: Floats, pairs: list[tuple[int, int]], reach: float) -> float:
        """Return how far partners may be apart in the end: by the residuals that there are."""
        blocks = self._blocks(values, pairs, min(reach, self.scene.edge), coarse=True)
        usual = robust_scale(blocks) * self._noise() * np.sqrt(2.0)
        return float(np.clip(_LAST * usual, 0.1 * self.scene.edge, reach))

    def _blocks(
        self, values: Floats, pairs: list[tuple[int, int]], gap: float, coarse: bool
    ) -> list[Pairs]:
        patches = self.scene.moved(values[DOF * self._views :])
        poses = _poses(values, self._views)
        reach = reach_of(gap, self.scene.edge)
        blocks = [
            match(
                (a, b),
                (patches[a], patches[b]),
                (poses[a], poses[b]),
                reach,
                max(1, len(patches[a]) // _COARSE) if coarse else 1,
            )
            for a, b in pairs
        ]
        return [block for block in blocks if len(block) >= _LEAST_PAIRS]

    def _solved(
        self,
        blocks: list[Pairs],
        values: Floats,
        gap: float,
        edge: float | None,
        fixed: Floats | None = None,
    ) -> tuple[System, Solution]:
        noise = Noise(scale=robust_scale(blocks), width=gap / _WIDTHS, lasting=self.scene.lasting)
        system = assemble(blocks, self.scene.slopes, self._views, noise, edge)
        return system, solve(system, values, self.prior_root, fixed)

    def _moved(self, values: Floats, solution: Solution) -> float:
        """Return by how many metres at most a step moves any view."""
        change = np.abs(solution.values - values)
        poses = change[: DOF * self._views].reshape(-1, DOF)
        most = float((poses[:, :3].sum(axis=1) * self.size + poses[:, 3:].sum(axis=1)).max())
        cell = change[DOF * self._views :]
        if self.scene.slopes is None or not len(cell):
            return most
        known = self.scene.slopes.of_patches
        length = [np.abs(slopes).max(axis=(0, 2)) for slopes in known if len(slopes)]
        return most + float((np.max(length, axis=0) * cell).sum()) if length else most


def reference_views(blocks: Sequence[Pairs], views: int) -> tuple[Ints, Ints]:
    """
    Return the first view of each set of views that hang together, and every view's set.

    returns : (sets,) view indices, (views,) set of each view
    """
    ends = np.array([(block.a, block.b) for block in blocks], dtype=np.int64).reshape(-1, 2)
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(views, views))
    _, member = connected_components(graph, directed=False)
    _, first = np.unique(member, return_index=True)
    return first.astype(np.int64), member.astype(np.int64)


def meetings(scene: Scene, poses: Floats, gap: float) -> list[Pairs]:
    """
    Return which patches have a partner in another view; each view is ``a`` once for each other.

    poses : (views, 4, 4); gap : metres, along the normal
    """
    if not np.isfinite(scene.edge):
        return []
    reach = reach_of(gap, scene.edge)
    blocks = [
        match((a, b), (scene.patches[a], scene.patches[b]), (poses[a], poses[b]), reach)
        for a, b in permutations(range(len(scene.patches)), 2)
    ]
    return [block for block in blocks if len(block) >= _LEAST_PAIRS]


def pose_values(T: Floats) -> Floats:
    """Return (6,) rotation vector (radians) and translation (metres) of a (4, 4) pose."""
    return np.concatenate([Rotation.from_matrix(T[:3, :3]).as_rotvec(), T[:3, 3]])


def _values(joint: Joint) -> Floats:
    return np.concatenate([*map(pose_values, joint.poses), joint.cell_values])


def _poses(values: Floats, views: int) -> Floats:
    moves = values[: DOF * views].reshape(views, DOF)
    turns = Rotation.from_rotvec(moves[:, :3]).as_matrix()
    return np.array(
        [transforms.rigid(R, move[3:]) for R, move in zip(turns, moves, strict=True)]
    ).reshape(views, 4, 4)


def _stepped(values: Floats, solution: Solution, views: int) -> Floats:
    """Return the unknowns after a step; poses are moved on, because rotations do not add up."""
    stepped = solution.values.copy()
    moved = _poses(solution.values - values, views) @ _poses(values, views)
    if views:
        poses = stepped[: DOF * views].reshape(views, DOF)
        poses[:, :3] = Rotation.from_matrix(moved[:, :3, :3]).as_rotvec()
        poses[:, 3:] = moved[:, :3, 3]
    return stepped


def _size(patches: Sequence[Patches]) -> float:
    """Return the distance of the farthest patch from the origin, metres."""
    return max((float(np.abs(p.points_xyz).max()) for p in patches if len(p)), default=0.0)
