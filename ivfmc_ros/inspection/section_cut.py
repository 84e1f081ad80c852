# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Section cuts: contours of mesh and nominal in a plane, with the deviations between them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.inspection.budget import COVERAGE_FACTOR
from ivfmc_ros.inspection.comparison import Comparison
from ivfmc_ros.inspection.edges import edge_distance
from ivfmc_ros.inspection.mesh_file import MeshBody
from ivfmc_ros.inspection.section_plane import AXES
from ivfmc_ros.inspection.section_plane import SectionPlane
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.surface import Surface

# Coordinates to the right and upwards in the drawing of a plane normal to x, y, z; right-handed
# with the direction to the eye, which is +x, -y, +z.
IN_PLANE = {'x': (1, 2), 'y': (0, 2), 'z': (0, 1)}
# Least length of the part of a unit normal that lies in the plane: a surface that is closer to the
# plane (12 degrees) has no contour whose distance could be drawn.
_MIN_IN_PLANE = 0.2


@dataclass(frozen=True, eq=False, kw_only=True)
class SectionCut:
    """
    Contours of the nominal and of the mesh in a plane of the nominal's frame.

    Coordinates are in the plane, right and up as ``IN_PLANE`` says, meters.

    axis, offset : of the plane; the offset in meters
    nominal : (k, 2, 2) ends of line segments
    measured : (m, 2, 2) likewise, of the aligned mesh
    deviations : (m, 2) meters at the ends, normal to the nominal in space as all deviations
    normals : (m, 2, 2) in-plane unit normals of the nominal there; 0 where it lies in the plane
    filled : (m,) bool, what only closes the mesh, and was not measured
    judged : (m,) bool, what counts: measured, and not at an edge of the nominal
    worst, worst_u : meters, deviation that is greatest, and its expanded uncertainty
    worst_end : which of the 2 m ends it is; -1 for none
    rms, median_u : meters, root mean square along the contour, median of the expanded uncertainty
    judged_length, nominal_length : meters, of the contours

    Of a section without a judged segment the figures are NaN.
    """

    axis: str
    offset: float
    nominal: Floats
    measured: Floats
    deviations: Floats
    normals: Floats
    filled: Bools
    judged: Bools
    worst: float
    worst_u: float
    worst_end: int
    rms: float
    median_u: float
    judged_length: float
    nominal_length: float

    @property
    def name(self) -> str:
        """Axis and coordinate in millimeters."""
        # no minus sign before zero
        return f'{self.axis} = {round(self.offset * 1e3, 3) + 0.0:.3f} mm'


def section_cuts(
    planes: Sequence[SectionPlane],
    comparison: Comparison,
    nominal: MeshBody,
    surface: Surface,
    of_face: Ints,
) -> list[SectionCut]:
    """
    Cut mesh and nominal.

    surface : of the nominal
    of_face : index of the region of each face of the nominal
    :raises ParameterError: a plane does not meet the nominal
    """
    cuts = []
    for plane in planes:
        axis, offset = AXES.index(plane.axis), _offset(plane, nominal)
        drawn = _crossings(nominal.vertices_xyz, nominal.faces, axis, offset)
        if not len(drawn.edges):
            raise _no_section(plane, nominal)
        met = _crossings(comparison.vertices_xyz, comparison.mesh.faces, axis, offset)
        cuts.append(_cut(plane.axis, offset, drawn, met, comparison, nominal, surface, of_face))
    return cuts


@dataclass(frozen=True, eq=False)
class _Crossings:
    """
    Segments in which triangles meet a plane.

    edges : (k, 2, 2) vertices of the two edges of a triangle that cross the plane
    share : (k, 2) place of the crossing on its edge, 0 to 1
    """

    edges: Ints
    share: Floats

    def values(self, of_vertices: Floats) -> Floats:
        """Return values of vertices, (n, ...), interpolated at the (k, 2) crossings."""
        share = self.share.reshape(self.share.shape + (1,) * (of_vertices.ndim - 1))
        first, second = of_vertices[self.edges[..., 0]], of_vertices[self.edges[..., 1]]
        return np.asarray((1.0 - share) * first + share * second)


def _crossings(vertices: Floats, faces: Ints, axis: int, offset: float) -> _Crossings:
    """
    Cut a triangle mesh by a plane.

    A vertex in the plane counts as above it, so that every triangle is cut in two points or none.
    """
    height = vertices[:, axis] - offset
    above = (height >= 0.0)[faces]
    count = above.sum(axis=1)
    cut = (count == 1) | (count == 2)
    faces, above, one_above = faces[cut], above[cut], count[cut] == 1
    # the corner that is alone on its side: both of its edges cross the plane
    apex = np.where(one_above, above.argmax(axis=1), above.argmin(axis=1))
    corners = np.take_along_axis(faces, (apex[:, None] + np.arange(3)) % 3, axis=1)
    edges = np.stack([corners[:, [0, 1]], corners[:, [0, 2]]], axis=1)
    # neighboring triangles compute the same point of their common edge
    edges = np.sort(edges, axis=2)
    low, high = height[edges[..., 0]], height[edges[..., 1]]
    return _Crossings(edges=edges, share=np.asarray(low / (low - high)))


def _cut(
    axis: str,
    offset: float,
    drawn: _Crossings,
    met: _Crossings,
    comparison: Comparison,
    nominal: MeshBody,
    surface: Surface,
    of_face: Ints,
) -> SectionCut:
    columns = list(IN_PLANE[axis])
    points = met.values(comparison.vertices_xyz)
    flat = points.reshape(-1, 3)
    filled = np.asarray(np.isnan(met.values(comparison.deviations)).any(axis=1))
    deviations = surface.signed_distance(flat).reshape(-1, 2)
    normals = _in_plane(surface.nearest(flat).normals[:, columns]).reshape(-1, 2, 2)
    from_edge = edge_distance(nominal.vertices_xyz, nominal.faces, of_face, flat).reshape(-1, 2)
    judged = np.asarray(~filled & (from_edge > comparison.settings.edge).all(axis=1))
    expanded = COVERAGE_FACTOR * met.values(comparison.uncertainty.combined)
    measured, wanted = points[..., columns], drawn.values(nominal.vertices_xyz)[..., columns]
    lengths = _lengths(measured)
    worst, rms = _figures(deviations, lengths, judged)
    at_worst = (
        (deviations.ravel()[worst], expanded.ravel()[worst]) if worst >= 0 else (np.nan,) * 2
    )
    return SectionCut(
        axis=axis,
        offset=offset,
        nominal=wanted,
        measured=measured,
        deviations=deviations,
        normals=normals,
        filled=filled,
        judged=judged,
        worst=float(at_worst[0]),
        worst_u=float(at_worst[1]),
        worst_end=worst,
        rms=rms,
        median_u=float(np.median(expanded[judged])) if worst >= 0 else np.nan,
        judged_length=float(lengths[judged].sum()),
        nominal_length=float(_lengths(wanted).sum()),
    )


def _figures(deviations: Floats, lengths: Floats, judged: Bools) -> tuple[int, float]:
    """Return the judged end with the greatest deviation, -1 for none, and the rms by length."""
    total = float(lengths[judged].sum())
    if not total > 0.0:
        return -1, np.nan
    size = np.where(judged[:, None], np.abs(deviations), -1.0)
    square = float((deviations[judged] ** 2).mean(axis=1) @ lengths[judged]) / total
    return int(size.argmax()), float(np.sqrt(square))


def _in_plane(normals: Floats) -> Floats:
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(np.where(length > _MIN_IN_PLANE, normals / np.maximum(length, 1e-12), 0.0))


def _lengths(segments: Floats) -> Floats:
    return np.asarray(np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1))


def _offset(plane: SectionPlane, nominal: MeshBody) -> float:
    if plane.offset is not None:
        return plane.offset
    values = nominal.vertices_xyz[:, AXES.index(plane.axis)]
    return float(0.5 * (values.min() + values.max()))


def _no_section(plane: SectionPlane, nominal: MeshBody) -> ParameterError:
    values = 1e3 * nominal.vertices_xyz[:, AXES.index(plane.axis)]
    return ParameterError(
        f'section: {plane.axis}={1e3 * (plane.offset or 0.0):g} mm does not cut the nominal, '
        f'which lies between {plane.axis} = {values.min():.4g} and {values.max():.4g} mm'
    )
