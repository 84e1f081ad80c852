# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Result folder of a reconstruction: mesh, point cloud, report images and report."""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import asdict
from datetime import datetime
from datetime import UTC
import json
from pathlib import Path
from typing import Any

import numpy as np

from ivfmc_ros import __version__
from ivfmc_ros import files
from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.inspection import deviation
from ivfmc_ros.inspection.reports import json_report
from ivfmc_ros.inspection.reports import overview
from ivfmc_ros.inspection.reports.html import write_html
from ivfmc_ros.inspection.reports.pdf import print_pdf
from ivfmc_ros.inspection.reports.scan_page import mesh_figures
from ivfmc_ros.inspection.reports.scan_page import mesh_still
from ivfmc_ros.inspection.reports.scan_page import scan_page
from ivfmc_ros.inspection.sampled_mesh import mesh_deviation
from ivfmc_ros.meshing.geometry.cut_rim import rim_figures
from ivfmc_ros.meshing.io import export
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Mesh
from ivfmc_ros.model import Poses
from ivfmc_ros.model import View
from ivfmc_ros.pipeline import Reconstruction
from ivfmc_ros.registration.merge.merge import Merged
from ivfmc_ros.registration.self_calibration.refine import RefinementResult
from ivfmc_ros.scan.title_block import cell_texts
from ivfmc_ros.scan.title_block import digest
from ivfmc_ros.stopwatch import Stopwatch
from ivfmc_ros.surface import Surface


def write_results(
    folder: Path,
    cell: Cell,
    made: Reconstruction,
    source: str,
    skipped: Mapping[str, int],
    nominal: Surface | None = None,
    *,
    pdf: bool = False,
    heading: Mapping[str, str] | None = None,
) -> Mapping[str, Any]:
    """
    Write a result folder atomically, and return its report.

    source : name of the scan or bag, for the report
    skipped : number of pictures that were not used, by reason
    nominal : true surface in ``turntable`` to compare with, if it is known
    pdf : print the page as report.pdf too
    heading : texts of the title block that the cell and the settings do not give
    :raises NotReadyError: there is no browser that prints
    :raises FileError: the folder has files already, or cannot be written
    """
    points, sigma = merged_cloud(made)
    watch = Stopwatch()
    with files.atomic_folder(folder) as target:
        with watch.stage('files'):
            _write_meshes(target, made, points, sigma)
        with watch.stage('pictures'):
            overview.write_mesh_sheet(target / 'mesh.png', made.mesh)
            overview.write_cloud_sheet(target / 'cloud.png', points, points[:, 2])
            # a reconstruction from stored profiles has no pictures
            if made.samples:
                overview.write_stripe_sheet(target / 'stripes.png', made.samples)
        if made.refined is not None:
            save_cell(target / 'cell.yaml', made.refined.cell)
        document = _document(cell, made, source, skipped, watch)
        if nominal is not None:
            document['deviation_m'] = deviation_report(points, made.mesh, nominal)
        json_report.write_report(target / 'report.json', document)
        page = scan_page(
            source,
            made.mesh,
            made.views,
            made.poses,
            made.samples,
            document,
            _heading(cell, source, document, heading or {}),
            mesh_still(target / 'mesh.png'),
        )
        write_html(target / 'report.html', page)
        if pdf:
            print_pdf(target / 'report.html', target / 'report.pdf')
    return document


def _document(
    cell: Cell,
    made: Reconstruction,
    source: str,
    skipped: Mapping[str, int],
    watch: Stopwatch,
) -> dict[str, Any]:
    """Return the figures of the report, without those that need a nominal."""
    document: dict[str, Any] = {
        'source': source,
        'unit': {'files': made.settings.export_unit, 'report': 'm'},
        'scale': json_report.scale(cell),
        'parameters': asdict(made.settings),
        'counts': {**made.counts, 'skipped': dict(skipped)},
        'seconds': {**made.seconds, **watch.seconds},
        'mesh': {
            **mesh_figures(made.mesh),
            'cut_rim': rim_figures(made.mesh, made.settings.acquisition.volume),
        },
        'residuals': json_report.residuals(cell, made.views, made.verdicts),
    }
    document.update(table_report(made))
    if made.clipping is not None:
        document['volume'] = asdict(made.clipping)
    if made.sheets is not None:
        document['sheets'] = asdict(made.sheets)
    if made.misfit is not None:
        document['lasers'] = asdict(made.misfit)
    if made.refined is not None:
        document['refined'] = refinement_report(made.refined)
    if made.merged is not None:
        document['merge'] = merge_report(made.merged)
    return document


def _heading(
    cell: Cell, source: str, document: Mapping[str, Any], given: Mapping[str, str]
) -> dict[str, str]:
    """Return the title block of the page; the operator signs on paper."""
    settings = json.dumps(document['parameters'], sort_keys=True, default=str)
    texts = {
        'source': source,
        'reconstructed (UTC)': f'{datetime.now(UTC):%Y-%m-%d %H:%M:%S}',
        **cell_texts(cell),
        **given,
        'settings (SHA-256)': digest(settings.encode()),
        'software': f'ivfmc_ros {__version__}',
    }
    if document.get('refined', {}).get('applied') and texts.get('certificate'):
        texts['certificate'] += ' (before the self-calibration)'
    return {**{name: text for name, text in texts.items() if text}, 'operator': ''}


def merged_cloud(made: Reconstruction) -> tuple[Floats, Floats]:
    """Return the points of all views in ``turntable``, (n, 3) meters, and their (n,) sigma."""
    return merged_points(made.views, made.poses)


def merged_points(views: Sequence[View], poses: Poses) -> tuple[Floats, Floats]:
    """Return the points of views in ``turntable``, (n, 3) meters, and their (n,) sigma."""
    posed = zip(views, poses.turntable_from_view, strict=True)
    points = np.concatenate([transforms.apply(T, view.cloud()) for view, T in posed])
    return points, np.concatenate([view.sigma[view.valid] for view in views])


def table_report(made: Reconstruction) -> dict[str, Any]:
    """Return code, detail and size of a slip, and how triggered pictures were numbered."""
    report: dict[str, Any] = {}
    if made.table is not None:
        report['code'] = 'OK' if made.table.code == 'UNCHECKED' else made.table.code
        report['detail'] = made.table.detail
        report['table'] = asdict(made.table)
    triggers = [
        {'view': motion.view, **asdict(motion.trigger)}
        for motion in made.motions
        if motion.trigger is not None
    ]
    return {**report, 'triggers': triggers} if triggers else report


def refinement_report(refined: RefinementResult) -> dict[str, Any]:
    """Return the report of a self-calibration: parameters in radians or meters, and the misfit."""
    return {
        'applied': refined.applied,
        'why': refined.why,
        'misfit_m': {'before': refined.rms_before, 'after': refined.rms_after},
        'unknowns': [asdict(estimate) for estimate in refined.estimates],
    }


def merge_report(merged: Merged) -> list[dict[str, Any]]:
    """Return the pose of each scan in the frame of the first, and how it was determined."""
    placed = zip(merged.placings, merged.first_from_clamping.tolist(), strict=True)
    return [{**asdict(placing), 'first_from_scan': T} for placing, T in placed]


def deviation_report(points_xyz: Floats, mesh: Mesh, nominal: Surface) -> dict[str, Any]:
    """Return the deviation of points and of the mesh from the true surface, meters."""
    return {
        'points': asdict(deviation.summarize(nominal.signed_distance(points_xyz))),
        'mesh': asdict(mesh_deviation(mesh.vertices_xyz, mesh.faces, nominal)),
    }


def _write_meshes(target: Path, made: Reconstruction, points: Floats, sigma: Floats) -> None:
    unit = made.settings.export_unit
    for suffix in ('stl', 'ply', 'obj'):
        export.write_mesh(target / f'mesh.{suffix}', made.mesh, unit)
    export.write_cloud(target / 'cloud.ply', points, sigma, unit)
