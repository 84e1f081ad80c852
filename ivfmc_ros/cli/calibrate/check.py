# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc calibrate check``: acceptance test of a cell with a calibrated artifact."""

from pathlib import Path
import sys
from typing import Any

import click

from ivfmc_ros import files
from ivfmc_ros.acceptance.artifact import parse_artifact
from ivfmc_ros.acceptance.artifact import SYNTAX
from ivfmc_ros.acceptance.certificate import write_certificate
from ivfmc_ros.acceptance.check import Check
from ivfmc_ros.acceptance.check import check_artifact
from ivfmc_ros.acceptance.check import Limits
from ivfmc_ros.acceptance.points import measured_points
from ivfmc_ros.acceptance.points import MeasuredPoints
from ivfmc_ros.acceptance.points import points_of_file
from ivfmc_ros.acceptance.record import check_document
from ivfmc_ros.acceptance.record import write_record
from ivfmc_ros.acceptance.state import record_path
from ivfmc_ros.cell.calibration_id import calibration_id
from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.cli.calibrate import options
from ivfmc_ros.cli.support.output import console
from ivfmc_ros.cli.support.output import json_option
from ivfmc_ros.cli.support.output import print_json
from ivfmc_ros.cli.support.progress import progress_bars
from ivfmc_ros.cli.support.quantities import length
from ivfmc_ros.cli.support.source import BagOptions
from ivfmc_ros.cli.support.source import read_scan
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.inspection.conditions import Conditions
from ivfmc_ros.inspection.mesh_file import read_mesh
from ivfmc_ros.inspection.mesh_file import SUFFIXES
from ivfmc_ros.inspection.verdict import FAIL
from ivfmc_ros.inspection.verdict import PASS
from ivfmc_ros.meshing.io.export import UNITS
from ivfmc_ros.pipeline import reconstruct
from ivfmc_ros.storage.catalogue.catalogue import Catalogue

_LIMIT = length(1e-9, 0.1)
_LIMITS = ('form', 'size', 'distance', 'flatness', 'step')
_EXIT_CODES = {PASS: 0, FAIL: 3}
_UNDECIDED = 4  # exit code


@click.command()
@click.argument('source', metavar='SCAN|BAG|MESH', type=options.PATH)
@click.option('--artifact', 'text', required=True, metavar='ARTIFACT', help=SYNTAX + '.')
@click.option(
    '--artifact-u',
    required=True,
    type=length(0.0, 1e-3),
    help='Standard uncertainty of its lengths and form, from its certificate (half of U).',
)
@click.option('--cell', 'cell_file', type=options.PATH, help='cell.yaml that took the scan.')
@click.option('--camera', 'camera_file', type=options.PATH, help='camera.yaml of that cell.')
@click.option(
    '--unit', type=click.Choice(list(UNITS)), default='mm', show_default=True, help='Of a MESH.'
)
@click.option('--form', type=_LIMIT, default='0.06mm', show_default=True, help='Limit, spheres.')
@click.option('--size', type=_LIMIT, default='0.03mm', show_default=True, help='Limit, diameter.')
@click.option('--distance', type=_LIMIT, default='0.03mm', show_default=True, help='Limit, bar.')
@click.option('--flatness', type=_LIMIT, default='0.06mm', show_default=True, help='Limit, plate.')
@click.option('--step', type=_LIMIT, default='0.03mm', show_default=True, help='Limit, step.')
@click.option(
    '--temperature', type=float, default=20.0, show_default=True, metavar='C', help='Of it.'
)
@click.option('--temperature-u', type=float, default=0.0, show_default=True, metavar='K',
              help='1 sigma of the temperature.')  # fmt: skip
@click.option('--expansion', type=float, default=11.5e-6, show_default=True, metavar='1/K',
              help='Thermal expansion of the artifact.')  # fmt: skip
@click.option('-o', '--output', type=options.PATH, required=True,
              help='Folder to make; must not exist yet.')  # fmt: skip
@click.option(
    '--exit-code',
    is_flag=True,
    help='Exit with 0 for pass, 3 for fail, 4 where nothing is decided.',
)
@json_option
def check(
    source: Path, text: str, output: Path, exit_code: bool, as_json: bool, **given: Any
) -> None:
    """
    Test a cell with the scan of a calibrated artifact: sphere, ball bar, plate or gauge step.

    Writes a certificate (PDF, PNG, HTML) and check.json to the output folder, and with --cell
    the record by which the scan service knows when the cell was tested last.
    """
    artifact = parse_artifact(text, given['artifact_u'])
    limits = Limits(**{name: given[name] for name in _LIMITS})
    conditions = Conditions(
        temperature=given['temperature'],
        temperature_u=given['temperature_u'],
        expansion=given['expansion'],
    )
    files.require_new_folder(output)
    points, cell = _points(source, given, limits.max_u(artifact))
    result = check_artifact(
        artifact,
        points,
        limits=limits,
        conditions=conditions,
        cell=cell,
    )
    identity = '' if cell is None else calibration_id(cell.turntable, cell.lasers)
    document = check_document(result, identity, str(source))
    _write(output, source, result, document, given['cell_file'])
    if as_json:
        print_json(document)
    else:
        _print(result, document, output)
    if exit_code:
        sys.exit(_EXIT_CODES.get(result.verdict, _UNDECIDED))


def _points(
    source: Path, given: dict[str, Any], max_u: float
) -> tuple[MeasuredPoints, Cell | None]:
    """Return the points of the scan with a U of at most ``max_u``, and the cell if known."""
    if not source.exists():
        raise FileError(f'{source}: no mesh, bag or scan folder of this name')
    cell_file, camera_file = given['cell_file'], given['camera_file']
    if source.suffix.lower() in SUFFIXES:
        body = read_mesh(source, given['unit'])
        return points_of_file(body, max_u), _cell(cell_file, camera_file)
    scan, cell = read_scan(source, cell_file, camera_file, BagOptions())
    with progress_bars() as progress:
        made = reconstruct(cell, scan.frames(), total=scan.frame_count, progress=progress)
    return measured_points(made.mesh, max_u), cell


def _cell(cell_file: Path | None, camera_file: Path | None) -> Cell | None:
    if cell_file is None:
        return None
    if camera_file is None:
        raise ParameterError('--cell needs --camera, the camera calibration that goes with it')
    return load_draft(cell_file).complete(load_camera(camera_file), str(cell_file))


def _write(
    output: Path, source: Path, result: Check, document: dict[str, Any], cell_file: Path | None
) -> None:
    with files.atomic_folder(output) as folder:
        write_record(folder / 'check.json', document)
        write_certificate(folder, result, document)
    if cell_file is not None:
        write_record(record_path(cell_file), document)
    _add_to_catalogue(source, output, document)


def _add_to_catalogue(source: Path, output: Path, document: dict[str, Any]) -> None:
    """Add a row to the catalogue if the source is, or lies in, the folder of a scan in one."""
    folder = source if source.is_dir() else source.parent
    root = folder.absolute().parent
    if not (root / 'catalogue.sqlite3').is_file():
        return
    catalogue = Catalogue(root)
    if folder.name in {row.scan_id for row in catalogue.scans()}:
        catalogue.add_result(folder.name, str(output.absolute()), {'check': document})
    catalogue.close()


def _print(result: Check, document: dict[str, Any], output: Path) -> None:
    stdout = console()
    for one in result.characteristics:
        stated = '' if one.u_cell is None else f', cell states U = {2e3 * one.u_cell:.4f} mm'
        stdout.print(
            f'{one.name}: {one.value * 1e3:+.4f} mm, limit {one.limit * 1e3:.3f} mm, '
            f'U = {2e3 * one.u_test:.4f} mm{stated}: {one.verdict}',
            soft_wrap=True,
        )
    stdout.print(f'verdict: {document["verdict"]}')
    for name in ('certificate.pdf', 'certificate.html', 'check.json'):
        stdout.print(str(output / name), soft_wrap=True)
