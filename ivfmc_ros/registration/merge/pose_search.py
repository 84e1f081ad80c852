# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
One body laid on another without a first guess: the one pose that fits, or none.

Guesses settle, the best are refined; what agrees and what contradicts decides between them. A
part with a symmetry looks the same in several poses, and no registration can tell which is true:
these are named, and none is chosen.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace

import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.errors import AmbiguousError
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.model import Floats
from ivfmc_ros.registration.merge.bodies import Body
from ivfmc_ros.registration.merge.coarse_icp import settle
from ivfmc_ros.registration.merge.free_motion import along
from ivfmc_ros.registration.merge.free_motion import catches
from ivfmc_ros.registration.merge.free_motion import Freedom
from ivfmc_ros.registration.merge.free_motion import freedom_of
from ivfmc_ros.registration.merge.hole_alignment import meetings_along
from ivfmc_ros.registration.merge.hole_alignment import moved_along
from ivfmc_ros.registration.merge.hole_alignment import Seat
from ivfmc_ros.registration.merge.hole_alignment import seat
from ivfmc_ros.registration.merge.hole_alignment import telling
from ivfmc_ros.registration.merge.motion_text import free_motion_in_words
from ivfmc_ros.registration.merge.motion_text import motion_in_words
from ivfmc_ros.registration.merge.point_pair_features import box_corners
from ivfmc_ros.registration.merge.point_pair_features import guess
from ivfmc_ros.registration.merge.point_pair_features import size_of
from ivfmc_ros.registration.merge.pose_evidence import Evidence
from ivfmc_ros.registration.merge.pose_evidence import Skin
from ivfmc_ros.registration.solver.gauss_newton import meetings
from ivfmc_ros.registration.solver.gauss_newton import Scene
from ivfmc_ros.registration.solver.gauss_newton import solve_jointly
from ivfmc_ros.registration.solver.normal_equations import DOF

# So many settled guesses are looked at closely, those with this share of the best overlap.
_LOOKED_AT, _RIVAL = 12, 0.7
# They are refined with about so many patches of each body; the last few with all.
_PATCHES = 6000
# Less agreement than this fixes nothing.
_LEAST_AGREE = 0.1
# As much contradiction, as a share of what agrees, and no pose is right.
_MOST_AGAINST = 0.1
# What contradicts counts so many times as much as what agrees.
_COUNTS = 3.0
# A pose is refuted where so many sigmas more contradict it than another.
_REFUTED = 4.0
# Surfaces within so many robust deviations of the residuals are the same, or within this share of
# the patches' spacing: next to edges a quadric errs by as much.
_SAME, _ROUGH = 6.0, 0.08
# Axes of holes miss each other by so many patch spacings at most, along a free motion.
_BORE = 1.5
# The refinement looks for errors of about this size, metres.
_LOOSE = 1e-3
_NAMED = 6


@dataclass(frozen=True, eq=False, kw_only=True)
class Placed:
    """
    Where a body lies on another.

    pose : (4, 4) onto_from_body; evidence : for and against it
    scale : metres, robust deviation of the surfaces from each other
    """

    pose: Floats
    evidence: Evidence
    freedom: Freedom
    scale: float

    @property
    def score(self) -> float:
        """What orders poses: what agrees less what contradicts."""
        return self.evidence.agree - _COUNTS * self.evidence.against

    @property
    def held(self) -> bool:
        """The surface leaves no motion open."""
        return not len(self.freedom.free)


def place(body: Body, onto: Body, edge: float) -> Placed:
    """
    Return the one pose under which the surfaces agree.

    edge : metres, between patches
    :raises GeometryError: there is none
    :raises AmbiguousError: there are several, or the surface does not hold it
    """
    guesses = settle(body, onto, guess(body, onto))
    near = guesses.share > _RIVAL * guesses.share.max(initial=0.0)
    poses = guesses.poses[near][:_LOOKED_AT]
    coarse = edge * np.sqrt(max(1.0, max(len(body), len(onto)) / _PATCHES))
    rough = _Bench(body.thinned(coarse), onto.thinned(coarse), coarse)
    first = rough.judged(poses, guesses.step / 2)
    _require_fit(body, onto, first)
    left = [one for one in first if one.evidence.worse_than(first[0].evidence) < 2.0 * _REFUTED]
    fine = _Bench(body, onto, edge)
    last = fine.judged([one.pose for one in left], 2.0 * edge)
    last = fine.distinct([*last, *fine.caught(last), *fine.bored(last)])
    _require_fit(body, onto, last)
    return _only_one(body, onto, [one for one in last if not _refuted(one, last)], edge)


class _Bench:
    """Refines and judges poses of one body on another."""

    def __init__(self, body: Body, onto: Body, edge: float) -> None:
        self._body, self._onto, self._edge = body, onto, edge
        self._skins = Skin(body, edge), Skin(onto, edge)

    def judged(self, poses: Sequence[Floats], reach: float) -> list[Placed]:
        """Return distinct refined poses, the best first."""
        return self.distinct([self._refined(T, reach) for T in poses])

    def caught(self, found: Sequence[Placed]) -> list[Placed]:
        """Return where the best that is free to move in one way would catch."""
        free = [one for one in found if len(one.freedom.free) == 1][:1]
        poses = [
            T @ one.pose
            for one in free
            for T in catches(
                self._body.moved(one.pose), self._onto, one.freedom.free[0], self._edge
            )
        ]
        return [self._refined(T, 2.0 * self._edge) for T in poses]

    def bored(self, found: Sequence[Placed]) -> list[Placed]:
        """Return where round holes hold the best that is free to move in one way."""
        free = [one for one in found if len(one.freedom.free) == 1][:1]
        return [held for one in free for held in self._holes_meet(one)]

    def _holes_meet(self, free: Placed) -> list[Placed]:
        motion = free.freedom.free[0]
        here = self._body.moved(free.pose)
        bores, others = telling(here.bores, motion), telling(self._onto.bores, motion)
        reach = _BORE * self._edge
        path = along(motion, here, self._edge / 2)
        poses = [path[k] @ free.pose for k in meetings_along(bores, others, path, reach)]
        turned = [replace(free, pose=T, evidence=self._evidence(T, free.scale)) for T in poses]
        left = [one for one in turned if not _refuted(one, turned)]
        # one that the holes do not hold, and nothing refutes, may be the true one
        if len(left) > _NAMED or any(self._seat(one) is None for one in left):
            return []
        held = [self._seated(self._refined(one.pose, 2.0 * self._edge)) for one in left]
        return [one for one in held if one is not None] if None not in held else []

    def _seated(self, one: Placed) -> Placed | None:
        """Return a pose that is free in one way where its holes meet; None if they do not."""
        if len(one.freedom.free) != 1:
            return one
        found = self._seat(one)
        if found is None:
            return None
        pose = moved_along(one.freedom.free[0], found.amount) @ one.pose
        return replace(
            one,
            pose=pose,
            evidence=self._evidence(pose, one.scale),
            freedom=one.freedom.held(found.sigma),
        )

    def _seat(self, one: Placed) -> Seat | None:
        motion = one.freedom.free[0]
        bores = telling(self._body.moved(one.pose).bores, motion)
        return seat(bores, telling(self._onto.bores, motion), motion, _BORE * self._edge)

    def _evidence(self, pose: Floats, scale: float) -> Evidence:
        noise = float(np.clip(_SAME * scale, _ROUGH * self._edge, self._edge))
        return self._skins[0].evidence(self._skins[1], pose, noise)

    def distinct(self, every: Sequence[Placed]) -> list[Placed]:
        """Return the best of those that are about the same, the best first."""
        corners = box_corners(self._body.patches.points_xyz)
        found: list[Placed] = []
        # of one that is free to move and one that is held there, the second says more
        for one in sorted(every, key=lambda each: (not each.held, -each.score)):
            here = transforms.apply(one.pose, corners)
            away = [np.abs(transforms.apply(other.pose, corners) - here).max() for other in found]
            if min(away, default=np.inf) > self._edge:
                found.append(one)
        return sorted(found, key=lambda each: -each.score)

    def _refined(self, T: Floats, reach: float) -> Placed:
        body = self._body.moved(T)
        scene = Scene(patches=[self._onto.patches, body.patches], slopes=None, edge=self._edge)
        joint = solve_jointly(scene, loose_root([self._onto, body]), reach)
        left = [np.abs(pairs.residuals) for pairs in meetings(scene, joint.poses, self._edge)]
        scale = 1.4826 * float(np.median(np.concatenate(left))) if left else self._edge
        pose = joint.poses[1] @ T
        return Placed(
            pose=pose,
            evidence=self._evidence(pose, scale),
            freedom=freedom_of(joint, 1, body.moved(joint.poses[1])),
            scale=scale,
        )


def loose_root(bodies: Sequence[Body]) -> Floats:
    """Return the prior's root: the first body stays, the others may move by a millimetre."""
    sigma = np.zeros((len(bodies), DOF))
    sigma[1:, :3] = 2.0 * _LOOSE / size_of(bodies[0])
    sigma[1:, 3:] = _LOOSE
    return np.diag(sigma.ravel())


def _require_fit(body: Body, onto: Body, ranked: Sequence[Placed]) -> None:
    where = f'merge: {body.name} finds no place on {onto.name}'
    if not ranked or ranked[0].evidence.agree < _LEAST_AGREE:
        raise GeometryError(f'{where}: they share too little surface')
    found = ranked[0].evidence
    if found.against > _MOST_AGAINST * found.agree:
        raise GeometryError(
            f'{where}: at best {found.agree:.0%} of the surface agree, and {found.against:.1%} '
            'contradict; is it the same part?'
        )


def _refuted(one: Placed, others: Sequence[Placed]) -> bool:
    """Tell whether another pose has as much surface in common, and clearly less against it."""
    return any(
        one.evidence.worse_than(other.evidence) > _REFUTED
        and other.evidence.agree > _RIVAL * one.evidence.agree
        for other in others
    )


def _only_one(body: Body, onto: Body, left: Sequence[Placed], edge: float) -> Placed:
    """
    Return the one of the poses that are not refuted which may be believed.

    :raises AmbiguousError: there is none
    """
    held = [one for one in left if one.held]
    if not held:
        _refuse_free(body, onto, left[0])
    best = held[0]
    rivals = [
        one
        for one in left
        if one is not best
        and one.evidence.agree > _RIVAL * best.evidence.agree
        and not _leads_to(one, best, body, edge)
    ]
    if rivals:
        _refuse_rivals(body, onto, [best, *rivals])
    return best


def _leads_to(one: Placed, best: Placed, body: Body, edge: float) -> bool:
    """
    Tell whether a pose that is free to move becomes another one when it does.

    Then the other is a place where that motion catches: there surfaces meet that elsewhere have
    no partner.
    """
    if len(one.freedom.free) != 1:
        return False
    corners = box_corners(body.patches.points_xyz)
    there = transforms.apply(best.pose, corners)
    path = along(one.freedom.free[0], body.moved(one.pose), edge)
    return any(
        np.abs(transforms.apply(T @ one.pose, corners) - there).max() < 2.0 * edge for T in path
    )


def _refuse_free(body: Body, onto: Body, best: Placed) -> None:
    free = [free_motion_in_words(motion) for motion in best.freedom.free]
    raise AmbiguousError(
        f'merge: {body.name} on {onto.name}: the surface that both show leaves open '
        f'{" and ".join(free)}, in coordinates of {onto.name}; a scan is needed that shows '
        'an edge, a hole or a flat that the other shows too',
        motions=free,
    )


def _refuse_rivals(body: Body, onto: Body, left: Sequence[Placed]) -> None:
    best = transforms.invert(left[0].pose)
    words = [motion_in_words(one.pose @ best) for one in left[1:]]
    more = f' and {len(words) - _NAMED} more' if len(words) > _NAMED else ''
    raise AmbiguousError(
        f'merge: {body.name} fits on {onto.name} in {len(left)} ways, which differ by '
        f'{"; ".join(words[:_NAMED])}{more}, in coordinates of {onto.name}; mark the part so '
        'that it has no symmetry, or scan a side that has none',
        motions=words,
    )
