# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Faults of a CAD model that are no faults of the part: faces turned over, another position."""

from dataclasses import replace

import numpy as np

from ivfmc_ros.inspection.alignment import align
from ivfmc_ros.inspection.alignment import Alignment
from ivfmc_ros.inspection.mesh_file import MeshBody
from ivfmc_ros.inspection.settings import InspectSettings
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.surface import Surface

# A fit from the current pose whose rms is larger than this fraction of the nominal's diagonal
# has not found the part: 2 mm of 100 mm, above the deviation of a part that was made from it.
_MAX_RMS = 0.02
# The global fit replaces it only if its rms is smaller by this factor: otherwise the part differs.
_MIN_GAIN = 3.0


def oriented(nominal: MeshBody) -> tuple[MeshBody, list[str]]:
    """
    Return a closed nominal whose faces all show outward, and what was turned.

    Faces are turned to agree with their neighbors, and all of them where the volume is negative.
    """
    import open3d as o3d

    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(nominal.vertices_xyz),
        o3d.utility.Vector3iVector(nominal.faces),
    )
    if not mesh.orient_triangles():
        # not orientable: as it is
        return nominal, []
    labels = np.asarray(mesh.cluster_connected_triangles()[0])
    faces = np.asarray(mesh.triangles).copy()
    for label in range(labels.max() + 1 if len(labels) else 0):
        chosen = labels == label
        # a cavity inside of a body has a negative volume, which stays
        before = _volume(nominal.vertices_xyz, nominal.faces[chosen])
        after = _volume(nominal.vertices_xyz, faces[chosen])
        if after < 0.0 and not (labels.max() > 0 and np.isclose(before, after)):
            faces[chosen] = faces[chosen][:, ::-1]
    turned = int(np.count_nonzero(_parity(faces) != _parity(nominal.faces)))
    if not turned:
        return nominal, []
    return replace(nominal, faces=faces), [
        f'nominal: {turned} of {len(faces)} faces showed inward and were turned over'
    ]


def align_to_nominal(
    points_xyz: Floats, surface: Surface, nominal: MeshBody, settings: InspectSettings
) -> tuple[Alignment, list[str]]:
    """
    Align points to the nominal, globally where ``best_fit`` starts too far away.

    returns : the alignment, and what the reader of the report has to know about it
    """
    method = settings.align
    found = align(points_xyz, surface, nominal.vertices_xyz, method, settings.tolerance)
    if found.rms <= _MAX_RMS * nominal.diagonal:
        return found, []
    far = f'{found.rms * 1e3:.3f} mm rms from the nominal'
    if method in {'best_fit', 'within_tolerance'}:
        other = align(points_xyz, surface, nominal.vertices_xyz, 'global')
        if _MIN_GAIN * other.rms < found.rms:
            return other, [
                f'nominal: it lies elsewhere or is turned; {method} left the mesh '
                f'{far}, and it was aligned globally ({other.rms * 1e3:.3f} mm)'
            ]
    return found, [
        f'nominal: the mesh is {far} after align {method}: it is another part, or lies elsewhere; '
        'try align global or datum'
    ]


def _volume(vertices_xyz: Floats, faces: Ints) -> float:
    a, b, c = (vertices_xyz[faces[:, index]] for index in range(3))
    return float((a * np.cross(b, c)).sum() / 6.0)


def _parity(faces: Ints) -> Bools:
    """Return whether the vertices of each face are an even permutation of sorted ones, (n,)."""
    a, b, c = faces.T
    return np.asarray((a < b) ^ (b < c) ^ (a < c))
