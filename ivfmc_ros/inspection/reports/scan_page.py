# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Content of the ``report.html`` of a scan: mesh, stripe images, point cloud and figures."""

from collections.abc import Mapping
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from ivfmc_ros.cell import transforms
from ivfmc_ros.inspection.reports import overview
from ivfmc_ros.inspection.reports.html import Page
from ivfmc_ros.inspection.reports.html import ReportImage
from ivfmc_ros.inspection.reports.rendering import draw_cloud
from ivfmc_ros.inspection.reports.rendering import Viewpoint
from ivfmc_ros.meshing.geometry.topology import boundary_loops
from ivfmc_ros.model import BASE
from ivfmc_ros.model import BRIDGED
from ivfmc_ros.model import FILLED
from ivfmc_ros.model import Frame
from ivfmc_ros.model import MEASURED
from ivfmc_ros.model import Mesh
from ivfmc_ros.model import Poses
from ivfmc_ros.model import Profile
from ivfmc_ros.model import View

_TILE = (560, 440)
_LISTED = 20
_KINDS = {'measured': MEASURED, 'bridged': BRIDGED, 'standing face': BASE, 'filled': FILLED}


def mesh_figures(mesh: Mesh) -> dict[str, Any]:
    """Return how many faces are of which kind, and where the mesh is open, meters."""
    loops = boundary_loops(mesh.vertices_xyz, mesh.faces)
    kind = np.zeros(len(mesh.faces)) if mesh.kind is None else mesh.kind
    return {
        'faces': {name: int((kind == number).sum()) for name, number in _KINDS.items()},
        'isolated_components': mesh.isolated_components,
        'decimation_deviation_m': mesh.decimation_deviation,
        'boundary_loops': len(loops),
        'longest_loops': [
            {'edges': loop.edges, 'length_m': loop.length, 'center_xyz_m': list(loop.center_xyz)}
            for loop in loops[:_LISTED]
        ],
    }


def scan_page(
    title: str,
    mesh: Mesh,
    views: Sequence[View],
    poses: Poses,
    samples: Sequence[tuple[Frame, Profile]],
    figures: Mapping[str, Any],
    heading: Mapping[str, str] | None = None,
    still: ReportImage | None = None,
) -> Page:
    """
    Return the page of a scan; the mesh is colored by the sigma of its vertices.

    heading, still : see ``Page``
    """
    known = mesh.sigma[np.isfinite(mesh.sigma)]
    return Page(
        title=title,
        vertices_xyz=mesh.vertices_xyz,
        faces=mesh.faces,
        values=mesh.sigma,
        span=float(np.percentile(known, 98)) if len(known) else 1e-3,
        figures=figures,
        signed=False,
        quantity='sigma',
        pictures=[*_clouds(views, poses), *_stripes(samples)],
        heading=heading or {},
        still=still,
    )


def _clouds(views: Sequence[View], poses: Poses) -> list[ReportImage]:
    if not views:
        return []
    before = [view.cloud() for view in views]
    posed = zip(before, poses.turntable_from_view, strict=True)
    after = [transforms.apply(T, cloud) for cloud, T in posed]
    number = np.repeat(np.arange(len(views)), [len(cloud) for cloud in before])
    viewpoint = Viewpoint.around(np.concatenate(before), np.radians(20), np.radians(25), _TILE)
    return [
        _jpeg(
            draw_cloud(np.concatenate(clouds), number.astype(np.float64), viewpoint),
            f'cloud {when} registration, a color for each view',
        )
        for clouds, when in ((before, 'before'), (after, 'after'))
    ]


def _stripes(samples: Sequence[tuple[Frame, Profile]]) -> list[ReportImage]:
    chosen = samples[:: max(1, len(samples) // 4)][:4]
    return [
        _jpeg(overview.overlay(frame, profile), f'picture {frame.seq} with the stripe found')
        for frame, profile in chosen
    ]


def _jpeg(picture: Any, caption: str) -> ReportImage:
    _, encoded = cv2.imencode('.jpg', picture, [cv2.IMWRITE_JPEG_QUALITY, 85])
    return ReportImage(data=encoded.tobytes(), media='image/jpeg', caption=caption)
