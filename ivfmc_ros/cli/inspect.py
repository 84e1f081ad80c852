# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc inspect``: compares a mesh with its CAD model and judges it by ISO 14253-1."""

from collections.abc import Sequence
from pathlib import Path
import sys
from typing import Any

import click
import numpy as np
from rich.markup import escape
from rich.table import Table
import yaml

from ivfmc_ros import files
from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.cli.support.output import console
from ivfmc_ros.cli.support.output import json_option
from ivfmc_ros.cli.support.output import pdf_option
from ivfmc_ros.cli.support.output import print_json
from ivfmc_ros.cli.support.quantities import length
from ivfmc_ros.errors import FileError
from ivfmc_ros.inspection.alignment import align_datums
from ivfmc_ros.inspection.alignment import Alignment
from ivfmc_ros.inspection.conditions import Conditions
from ivfmc_ros.inspection.datum_alignment import align_features
from ivfmc_ros.inspection.inspect import inspect as run
from ivfmc_ros.inspection.inspect import Inspection
from ivfmc_ros.inspection.mesh_file import MeshBody
from ivfmc_ros.inspection.mesh_file import read_mesh
from ivfmc_ros.inspection.mesh_file import require_closed
from ivfmc_ros.inspection.mesh_file import require_similar_size
from ivfmc_ros.inspection.missing_surface import missing_texts
from ivfmc_ros.inspection.reports.html import write_html
from ivfmc_ros.inspection.reports.inspection_page import inspection_page
from ivfmc_ros.inspection.reports.json_report import write_report
from ivfmc_ros.inspection.reports.pdf import find_browser
from ivfmc_ros.inspection.reports.pdf import print_pdf
from ivfmc_ros.inspection.reports.summary import document
from ivfmc_ros.inspection.section_plane import MIDDLE_PLANES
from ivfmc_ros.inspection.section_plane import parse_sections
from ivfmc_ros.inspection.settings import ALIGNMENTS
from ivfmc_ros.inspection.settings import InspectSettings
from ivfmc_ros.inspection.tolerances import load_tolerances
from ivfmc_ros.inspection.tolerances import Tolerances
from ivfmc_ros.inspection.verdict import FAIL
from ivfmc_ros.inspection.verdict import PASS
from ivfmc_ros.meshing.io.export import UNITS
from ivfmc_ros.scan.title_block import source_texts

_MM = 1e-3
_COLORS = {PASS: 'green', FAIL: 'bold red'}
_EXIT_CODES = {PASS: 0, FAIL: 3}
_UNDECIDED = 4  # exit code


@click.command()
@click.argument('mesh', type=click.Path(path_type=Path))
@click.option(
    '--nominal',
    type=click.Path(path_type=Path),
    required=True,
    help='The CAD model as a closed mesh.',
)
@click.option(
    '--unit', type=click.Choice(list(UNITS)), default='mm', show_default=True, help='Unit of MESH.'
)
@click.option(
    '--nominal-unit',
    type=click.Choice(list(UNITS)),
    default='mm',
    show_default=True,
    help='Unit of the nominal.',
)
@click.option(
    '--tolerance',
    type=length(1e-9, 1.0),
    default='0.1mm',
    show_default=True,
    help='Largest deviation allowed to either side.',
)
@click.option(
    '--tolerances',
    type=click.Path(path_type=Path),
    help="YAML with tolerances of single features in mm: {features: {'cylinder 3': {diameter: "
    '0.05, position: 0.2}}}.',
)
@click.option(
    '--align',
    type=click.Choice(ALIGNMENTS),
    default='best_fit',
    show_default=True,
    help='How the mesh is aligned to the nominal; global needs no first guess, within_tolerance '
    'makes the excess over the tolerance small, datum uses points or datum features.',
)
@click.option(
    '--datum',
    type=click.Path(path_type=Path),
    help="YAML for --align datum: 'measured' and 'nominal', lists of points in mm; or 'datums', "
    'the names of up to three features in order: [plane 1, cylinder 2, plane 4].',
)
@click.option(
    '--cell',
    'cell_path',
    type=click.Path(path_type=Path),
    help='cell.yaml with which MESH was measured: its covariances count as uncertainty.',
)
@click.option(
    '--camera',
    'camera_path',
    type=click.Path(path_type=Path),
    help='Camera calibration that goes with --cell.',
)
@click.option(
    '--vertex-u',
    type=length(1e-9, 1.0),
    help='Standard uncertainty of the vertices of a MESH that another instrument measured.',
)
@click.option(
    '--scale-u',
    type=float,
    default=0.0,
    show_default=True,
    metavar='RELATIVE',
    help='1 sigma of the known length that gave the scale, as a share of it; 0: as --cell states.',
)
@click.option(
    '--temperature',
    type=float,
    default=20.0,
    show_default=True,
    metavar='C',
    help='Of the part; lengths are reported at 20 C.',
)
@click.option(
    '--temperature-u',
    type=float,
    default=0.0,
    show_default=True,
    metavar='K',
    help='1 sigma of the temperature.',
)
@click.option(
    '--expansion',
    type=float,
    default=11.5e-6,
    show_default=True,
    metavar='1/K',
    help='Thermal expansion of the part.',
)
@click.option(
    '--section',
    'sections',
    multiple=True,
    metavar='PLANE',
    help="Plane in which mesh and nominal are drawn over each other, in the nominal's frame: "
    'z=12.5 (mm), or z for the middle; more than once for more; none for none. Default: three '
    'through the middle.',
)
@click.option('-o', '--output', type=click.Path(path_type=Path), required=True,
              help='Folder to make; must not exist yet.')  # fmt: skip
@click.option(
    '--exit-code',
    is_flag=True,
    help='Exit with 0 for pass, 3 for fail, 4 if undecided.',
)
@pdf_option
@json_option
def inspect(
    mesh: Path,
    nominal: Path,
    output: Path,
    exit_code: bool,
    pdf: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Compare MESH with its CAD model: deviations, sizes, and a verdict by ISO 14253-1."""
    if pdf:
        find_browser()
    settings = _settings(options)
    files.require_new_folder(output)
    cell = _cell(options['cell_path'], options['camera_path'])
    settings = settings.with_scale_of(cell)
    measured = read_mesh(mesh, options['unit'])
    wanted = read_mesh(nominal, options['nominal_unit'])
    units = options['unit'], options['nominal_unit']
    require_similar_size(measured, wanted, (mesh, nominal), units)
    require_closed(wanted, nominal)
    alignment, settings = _alignment(measured, wanted, settings, options['datum'])
    found = run(measured, wanted, settings, cell, alignment)
    figures = {'mesh': str(mesh), 'nominal': str(nominal), **document(found, settings)}
    with files.atomic_folder(output) as folder:
        write_report(folder / 'report.json', figures)
        title = f'{mesh.name} against {nominal.name}'
        heading = source_texts(mesh.absolute().parent, options['cell_path'])
        page = inspection_page(title, found, settings, figures, heading)
        write_html(folder / 'report.html', page)
        if pdf:
            print_pdf(folder / 'report.html', folder / 'report.pdf')
    if as_json:
        print_json(figures)
    else:
        _print(found, figures, output)
    if exit_code:
        sys.exit(_EXIT_CODES.get(figures['verdict'], _UNDECIDED))


def _settings(options: dict[str, Any]) -> InspectSettings:
    tolerances = Tolerances(default=options['tolerance'])
    if options['tolerances'] is not None:
        tolerances = load_tolerances(options['tolerances'], options['tolerance'])
    return InspectSettings(
        tolerance=tolerances.default,
        features=tolerances.features,
        vertex_u=options['vertex_u'],
        align=options['align'],
        sections=parse_sections(options['sections']) if options['sections'] else MIDDLE_PLANES,
        conditions=Conditions(
            scale_u=options['scale_u'],
            temperature=options['temperature'],
            temperature_u=options['temperature_u'],
            expansion=options['expansion'],
        ),
    )


def _cell(cell_path: Path | None, camera_path: Path | None) -> Cell | None:
    if cell_path is None:
        return None
    if camera_path is None:
        raise click.UsageError('--cell needs --camera, the camera calibration that goes with it')
    return load_draft(cell_path).complete(load_camera(camera_path), str(cell_path))


def _alignment(
    measured: MeshBody, wanted: MeshBody, settings: InspectSettings, path: Path | None
) -> tuple[Alignment | None, InspectSettings]:
    """Return the alignment by datums, or None if it is found by the inspection."""
    if settings.align != 'datum':
        return None, settings
    if path is None:
        raise click.UsageError('--align datum needs --datum, a file of points or of features')
    try:
        read = yaml.safe_load(path.read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise FileError(f'{path}: cannot be read as YAML ({error})') from error
    if isinstance(read, dict) and 'datums' in read:
        names = read['datums']
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise FileError(f"{path}: 'datums' must be a list of feature names")
        return align_features(measured, wanted, names, settings), settings
    return _datum_points(path, read), settings


def _datum_points(path: Path, read: Any) -> Alignment:
    try:
        points = [np.array(read[key], dtype=np.float64) for key in ('measured', 'nominal')]
    except (KeyError, TypeError, ValueError) as error:
        raise FileError(
            f"{path}: 'measured' and 'nominal' must be lists of x, y, z in mm ({error})"
        ) from error
    if any(p.ndim != 2 or p.shape[1] != 3 for p in points):
        raise FileError(f"{path}: 'measured' and 'nominal' must be lists of x, y, z in mm")
    return align_datums(points[0] * _MM, points[1] * _MM)


def _print(found: Inspection, figures: dict[str, Any], output: Path) -> None:
    stdout = console(markup=True)
    stdout.print(_surface_table(figures['surface']))
    stdout.print(_characteristics_table(figures['characteristics']))
    for note in found.notes:
        stdout.print(escape(note), soft_wrap=True)
    for row in figures['features']:
        if row['reason']:
            stdout.print(escape(f'{row["name"]}: {row["reason"]}'), soft_wrap=True)
    if found.unseen:
        stdout.print(f'not measured, not judged: {", ".join(found.unseen)}')
    for text in missing_texts(found.missing):
        stdout.print(text, soft_wrap=True)
    stdout.print(f'verdict: {_colored(figures)}')
    for name in ('report.html', 'report.pdf', 'report.json'):
        if (output / name).exists():
            stdout.print(escape(str(output / name)), soft_wrap=True)


def _surface_table(rows: list[dict[str, Any]]) -> Table:
    table = _table('surface, mm', ('region', 'rms', '95 %', 'max', 'within', 'coverage', 'U'))
    for row in rows:
        values = [f'{row[key] * 1e3:.4f}' for key in ('rms_m', 'p95_m', 'worst_m')]
        shares = f'{100.0 * row["within"]:.2f} %', f'{100.0 * row["coverage"]:.0f} %'
        table.add_row(row['name'], *values, *shares, _length(row['U_m']), _colored(row))
    return table


def _characteristics_table(rows: list[dict[str, Any]]) -> Table:
    columns = ('feature', 'characteristic', 'nominal', 'measured', 'deviation', 'U', 'tolerance')
    table = _table('features, mm', columns)
    for row in rows:
        keys = ('nominal_m', 'measured_m', 'deviation_m', 'U_m', 'tolerance_m')
        values = [_length(row[key]) for key in keys]
        table.add_row(row['feature'], row['characteristic'], *values, _colored(row))
    return table


def _table(title: str, columns: Sequence[str]) -> Table:
    table = Table(title=title, title_justify='left')
    for column in (*columns, 'verdict'):
        left = column in {'region', 'feature', 'characteristic', 'verdict'}
        table.add_column(column, justify='left' if left else 'right')
    return table


def _length(value: float) -> str:
    return f'{value * 1e3:.4f}' if np.isfinite(value) else ''


def _colored(row: dict[str, Any]) -> str:
    return f'[{_COLORS.get(row["verdict"], "yellow")}]{row["verdict"]}[/]'
