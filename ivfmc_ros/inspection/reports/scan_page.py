# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Content of the ``report.html`` of a scan: mesh, stripe images, point cloud and figures."""

from collections.abc import Mapping
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ivfmc_ros.inspection.reports.color_scale import ColorBar
from ivfmc_ros.inspection.reports.html import Page
from ivfmc_ros.inspection.reports.html import ReportImage
from ivfmc_ros.inspection.reports.registration_maps import registration_maps
from ivfmc_ros.inspection.reports.stripe_pictures import overlay
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

# Pixels of the printed picture of the mesh.
_STILL_WIDTH = 1400
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
        pictures=[*_clouds(mesh, views, poses), *_stripes(samples)],
        heading=heading or {},
        still=still,
    )


def mesh_still(path: Path) -> ReportImage | None:
    """Return the picture of the mesh at ``path``, smaller, for the printed page; None if none."""
    image = cv2.imread(str(path))
    if image is None:
        return None
    scale = min(1.0, _STILL_WIDTH / image.shape[1])
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return _jpeg(small, 'mesh from several sides')


def _clouds(mesh: Mesh, views: Sequence[View], poses: Poses) -> list[ReportImage]:
    return [
        _jpeg(picture, caption, bar)
        for picture, caption, bar in registration_maps(mesh, views, poses)
    ]


def _stripes(samples: Sequence[tuple[Frame, Profile]]) -> list[ReportImage]:
    chosen = samples[:: max(1, len(samples) // 4)][:4]
    return [
        _jpeg(
            overlay(frame, profile),
            f'image {frame.seq} with the stripe found in orange; enlarged: each dot is the '
            'position in a row',
        )
        for frame, profile in chosen
    ]


def _jpeg(picture: Any, caption: str, bar: ColorBar | None = None) -> ReportImage:
    _, encoded = cv2.imencode('.jpg', picture, [cv2.IMWRITE_JPEG_QUALITY, 85])
    return ReportImage(data=encoded.tobytes(), media='image/jpeg', caption=caption, bar=bar)
