# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Several clampings of one part brought together, without a first guess.

Each scan is one rigid body. It is placed on those that are placed already, and in the end all
are refined together.
"""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace

import numpy as np

from ivfmc_ros.errors import GeometryError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.registration.merge.bodies import bodies_of
from ivfmc_ros.registration.merge.bodies import Body
from ivfmc_ros.registration.merge.bodies import Clamping
from ivfmc_ros.registration.merge.bodies import together
from ivfmc_ros.registration.merge.free_motion import freedom_of
from ivfmc_ros.registration.merge.pose_search import loose_root
from ivfmc_ros.registration.merge.pose_search import place
from ivfmc_ros.registration.merge.pose_search import Placed
from ivfmc_ros.registration.solver.gauss_newton import meetings
from ivfmc_ros.registration.solver.gauss_newton import Scene
from ivfmc_ros.registration.solver.gauss_newton import solve_jointly
from ivfmc_ros.registration.solver.verdict import fit_of

# Partners in the last refinement, in patch spacings.
_REACH = 2.0


@dataclass(frozen=True, kw_only=True)
class Placing:
    """
    How a clamping was placed.

    onto : the clampings that were placed before
    agree, differ, blocked : shares of their surfaces, see Evidence
    sigma : metres, by how much the pose may move the part, 1 sigma
    overlap : share of its surface that the others show too; rms : metres, between the two, trimmed
    """

    name: str
    onto: tuple[str, ...] = ()
    agree: float = 1.0
    differ: float = 0.0
    blocked: float = 0.0
    sigma: float = 0.0
    overlap: float = 0.0
    rms: float = float('nan')


@dataclass(frozen=True, eq=False, kw_only=True)
class Merged:
    """
    Clampings in the ``turntable`` of the first.

    first_from_clamping : (clampings, 4, 4) rigid; placings : how each was found
    views, poses : of all clampings, numbered on
    """

    first_from_clamping: Floats
    placings: list[Placing]
    views: list[View]
    poses: Poses


def merge(clampings: Sequence[Clamping]) -> Merged:
    """
    Bring the clampings of one part together.

    :raises ParameterError: fewer than two, or two of one name
    :raises GeometryError: one of them finds no place on the others
    :raises AmbiguousError: it fits in several ways, or the surface does not hold it
    """
    require_several([clamping.name for clamping in clampings])
    bodies, edge = bodies_of(clampings)
    found = _placed(bodies, edge)
    return _refined(clampings, bodies, edge, found)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Found:
    onto: tuple[str, ...]
    placed: Placed


def _placed(bodies: Sequence[Body], edge: float) -> Mapping[int, _Found]:
    """Return where each body but the first lies on those that were placed before it."""
    found: dict[int, _Found] = {}
    waiting = list(range(1, len(bodies)))
    while waiting:
        there = {0: np.eye(4), **{index: one.placed.pose for index, one in found.items()}}
        onto = together([bodies[index].moved(T) for index, T in there.items()])
        index, placed = _next(bodies, waiting, onto, edge)
        found[index] = _Found(onto=tuple(bodies[k].name for k in there), placed=placed)
        waiting.remove(index)
    return found


def _next(
    bodies: Sequence[Body], waiting: Sequence[int], onto: Body, edge: float
) -> tuple[int, Placed]:
    """Return the first of those that wait which can be placed."""
    refusals: list[GeometryError] = []
    for index in waiting:
        try:
            return index, place(bodies[index], onto, edge)
        except GeometryError as error:
            # another one may bring the surface that it needs
            refusals.append(error)
    raise refusals[0]


def _refined(
    clampings: Sequence[Clamping],
    bodies: Sequence[Body],
    edge: float,
    found: Mapping[int, _Found],
) -> Merged:
    """Solve all poses once more, jointly."""
    guessed = [found[k].placed.pose if k in found else np.eye(4) for k in range(len(bodies))]
    there = [body.moved(T) for body, T in zip(bodies, guessed, strict=True)]
    scene = Scene(patches=[body.patches for body in there], slopes=None, edge=edge)
    joint = solve_jointly(scene, loose_root(there), _REACH * edge)
    poses = [P @ T for P, T in zip(joint.poses, guessed, strict=True)]
    after = meetings(scene, joint.poses, edge)
    placings = []
    for index, body in enumerate(there):
        fit = fit_of(index, after, len(body))
        freedom = freedom_of(joint, index, body)
        placing = Placing(name=body.name, overlap=fit.overlap, rms=fit.rms)
        if index in found:
            placed = found[index].placed
            evidence = placed.evidence
            # a joint solution does not know of the holes
            known = min(freedom.sigma.max(), placed.freedom.sigma.max())
            placing = replace(
                placing,
                onto=found[index].onto,
                agree=evidence.agree,
                differ=evidence.differ,
                blocked=evidence.blocked,
                sigma=float(known),
            )
        placings.append(placing)
    return Merged(
        first_from_clamping=np.array(poses),
        placings=placings,
        views=_numbered([view for clamping in clampings for view in clamping.views]),
        poses=Poses(
            turntable_from_view=np.concatenate(
                [
                    T @ clamping.poses.turntable_from_view
                    for T, clamping in zip(poses, clampings, strict=True)
                ]
            )
        ),
    )


def _numbered(views: Sequence[View]) -> list[View]:
    return [replace(view, number=number) for number, view in enumerate(views)]


def require_several(names: Sequence[str]) -> None:
    """
    Refuse names of scans that are not two or more different ones.

    :raises ParameterError: says what is wrong
    """
    if len(names) < 2:
        known = ', '.join(names) or 'none'
        raise ParameterError(f'merge: two or more scans are needed, not {known}')
    if len(set(names)) < len(names):
        raise ParameterError(f'merge: a scan is named twice: {", ".join(names)}')


def require_one_cell(clampings: Sequence[Clamping]) -> None:
    """
    Refuse clampings of different cells, of which no mesh can be made.

    :raises ParameterError: names them
    """
    first, *others = clampings
    for other in others:
        if _optics(other) != _optics(first):
            raise ParameterError(
                f'merge: {first.name} and {other.name} were taken with different cells (lasers, '
                'or size of the picture)'
            )


def _optics(clamping: Clamping) -> tuple[object, ...]:
    cell = clamping.cell
    return cell.camera.width, cell.camera.height, *(laser.name for laser in cell.lasers)
