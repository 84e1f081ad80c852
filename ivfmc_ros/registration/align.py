# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of all views of a scan by the chosen method, with the table's angle as initial pose."""

from collections.abc import Sequence

from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.registration.pairwise import register_pairwise
from ivfmc_ros.registration.solver.prior import TablePrior
from ivfmc_ros.registration.solver.verdict import Verdict
from ivfmc_ros.registration.table import register_jointly
from ivfmc_ros.validation import require_one_of

__all__ = ['METHODS', 'Verdict', 'align']

METHODS = ('table', 'paper', 'point_to_plane', 'joint')


def align(
    views: Sequence[View],
    method: str,
    max_correspondence_distance: float = 1.5e-3,
    prior: TablePrior | None = None,
) -> tuple[Poses, list[Verdict]]:
    """
    Find the pose of every view, with the table's angle as initial pose.

    The first view defines the frame. 'paper' (point-to-point ICP) and 'point_to_plane' align
    each further view to those before it. 'joint' solves for all poses together, as far as the
    data determine them better than the prior. 'table' keeps the table's poses.

    max_correspondence_distance : meters, points farther apart do not correspond
    prior : standard deviations of the table's poses, for 'joint'
    :raises ParameterError: unknown method
    :raises GeometryError: a view has points farther than 100 m away, or partly finite points
    """
    require_one_of('registration', method, METHODS)
    if method == 'joint':
        return register_jointly(views, prior or TablePrior(), max_correspondence_distance)
    return register_pairwise(views, method, max_correspondence_distance)
