# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Views of an inspected mesh: colors of the deviations, and a callout at each feature."""

from collections.abc import Mapping
from dataclasses import dataclass
import math

import cv2
import numpy as np

from ivfmc_ros.inspection.inspect import Inspection
from ivfmc_ros.inspection.reports.callouts import Callout
from ivfmc_ros.inspection.reports.callouts import place_callouts
from ivfmc_ros.inspection.reports.callouts import Point
from ivfmc_ros.inspection.reports.color_scale import ColorBar
from ivfmc_ros.inspection.reports.rendering import ColorImage
from ivfmc_ros.inspection.reports.rendering import scale_bar
from ivfmc_ros.inspection.reports.rendering import Viewpoint
from ivfmc_ros.inspection.verdict import FAIL
from ivfmc_ros.inspection.verdict import PASS
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.surface import Surface

# Pixels of a view in the page; it is rendered with twice as many for the printed page.
SIZE = (430, 400)
_OVERSAMPLING = 2
# Pixels of the views among which the best are chosen.
_PREVIEW = (160, 150)
# Degrees, azimuth and elevation of the eye: around the part, from above, from below.
_DIRECTIONS = (
    *((azimuth, 30) for azimuth in range(20, 380, 45)),
    (20, 85),
    (20, -35),
    (200, -35),
)
_MAX_VIEWS = 4
# Share of the pixels of a view that a feature must have to be named in it.
_MIN_SHARE = 2e-4
_PAPER = 255.0


@dataclass(frozen=True, eq=False, kw_only=True)
class LabeledView:
    """
    A picture of a mesh with callouts.

    picture : (height, width, 3) BGR, ``_OVERSAMPLING`` times ``SIZE``
    callouts : in pixels of ``SIZE``
    bar : (length in meters, pixels of ``SIZE``) of the scale bar
    direction : (azimuth, elevation) of the eye, degrees
    unnamed : features that are seen, for which there was no room
    """

    picture: ColorImage
    callouts: list[Callout]
    bar: tuple[float, float]
    direction: tuple[int, int]
    unnamed: int


def labeled_views(
    found: Inspection, colors: ColorBar, verdicts: Mapping[str, str]
) -> list[LabeledView]:
    """
    Return up to four views in which together as many features as possible are seen.

    colors : of the deviations
    verdicts : by name of the region; what is not passed is named first where there is little room
    """
    surface = Surface(found.vertices_xyz, found.faces)
    chosen = _chosen_directions(surface, found)
    return [_labeled(surface, found, colors, verdicts, direction) for direction in chosen]


def _viewpoint(found: Inspection, direction: tuple[int, int], size: tuple[int, int]) -> Viewpoint:
    azimuth, elevation = (math.radians(value) for value in direction)
    return Viewpoint.around(found.vertices_xyz, azimuth, elevation, size)


def _regions(found: Inspection, faces: Ints, weights: Floats) -> Ints:
    """Return the region of the nearest vertex of each hit face, -1 for none."""
    corner = np.take_along_axis(found.faces[faces], weights.argmax(axis=1)[:, None], axis=1)[:, 0]
    return np.where(faces >= 0, found.owner[corner], -1)


def _chosen_directions(surface: Surface, found: Inspection) -> list[tuple[int, int]]:
    """Return directions, each of which shows most of what the ones before do not."""
    seen = np.zeros((len(_DIRECTIONS), len(found.region_names)))
    for row, direction in enumerate(_DIRECTIONS):
        hits = surface.cast(*_viewpoint(found, direction, _PREVIEW).rays())
        region = _regions(found, hits.faces, hits.weights)
        seen[row] = np.bincount(region[region >= 0], minlength=len(found.region_names))
    seen[seen < _MIN_SHARE * _PREVIEW[0] * _PREVIEW[1]] = 0.0
    # the view in which a region is largest shows it best
    gain = np.sqrt(seen / np.maximum(seen.max(axis=0), 1.0))
    best = np.zeros(len(found.region_names))
    chosen: list[tuple[int, int]] = []
    while len(chosen) < _MAX_VIEWS:
        added = (gain - best).clip(0.0).sum(axis=1)
        row = int(added.argmax())
        # less than half a feature is no reason for one view more
        if len(chosen) >= 2 and added[row] < 0.5:
            break
        if _DIRECTIONS[row] in chosen:
            break
        chosen.append(_DIRECTIONS[row])
        best = np.maximum(best, gain[row])
    return chosen


def _labeled(
    surface: Surface,
    found: Inspection,
    colors: ColorBar,
    verdicts: Mapping[str, str],
    direction: tuple[int, int],
) -> LabeledView:
    size = (SIZE[0] * _OVERSAMPLING, SIZE[1] * _OVERSAMPLING)
    view = _viewpoint(found, direction, size)
    hits = surface.cast(*view.rays())
    region = _regions(found, hits.faces, hits.weights)
    hit = hits.faces >= 0
    values = (found.deviations[found.faces[hits.faces[hit]]] * hits.weights[hit]).sum(axis=1)
    image = np.full((len(region), 3), _PAPER)
    # a deviation must stay readable: shading is weak
    light = 0.6 + 0.4 * np.abs(hits.normals[hit] @ view.towards)
    image[hit] = colors.colors(values) * light[:, None]
    shape = (view.height, view.width)
    regions = region.reshape(shape)
    picture = image.reshape(*shape, 3)
    picture[_borders(regions)] *= 0.55
    anchors = _anchors(regions, [verdicts.get(name, '') for name in found.region_names])
    callouts = place_callouts(anchors, SIZE)
    return LabeledView(
        picture=picture.astype(np.uint8),
        callouts=callouts,
        bar=scale_bar(view.scale / _OVERSAMPLING, SIZE[0]),
        direction=direction,
        unnamed=len(anchors) - len(callouts),
    )


def _borders(regions: Ints) -> Bools:
    """Return the pixels, (height, width) bool, at which another region begins."""
    border = np.zeros(regions.shape, dtype=bool)
    border[:, 1:] |= _differ(regions[:, 1:], regions[:, :-1])
    border[1:] |= _differ(regions[1:], regions[:-1])
    return border


def _differ(one: Ints, other: Ints) -> Bools:
    # vertices of no region lie scattered at the edges
    return np.asarray((one != other) & (one >= 0) & (other >= 0))


def _anchors(regions: Ints, verdicts: list[str]) -> list[tuple[int, Point]]:
    """Return number and innermost pixel of the regions that are seen, worst verdict first."""
    found = []
    for index, verdict in enumerate(verdicts):
        mask = (regions == index).astype(np.uint8)
        area = int(mask.sum())
        if area < _MIN_SHARE * mask.size:
            continue
        # the picture's border is no inside
        depth = cv2.distanceTransform(cv2.copyMakeBorder(mask, 1, 1, 1, 1, 0), cv2.DIST_L2, 5)
        row, column = np.unravel_index(int(depth.argmax()), depth.shape)
        rank = 0 if verdict == FAIL else 2 if verdict == PASS else 1
        place = ((column - 1) / _OVERSAMPLING, (row - 1) / _OVERSAMPLING)
        found.append((rank, -area, index + 1, place))
    return [(number, place) for _, _, number, place in sorted(found)]
