# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc scans statistics``: run chart and process capability of a measured value."""

from dataclasses import asdict
import math
from pathlib import Path
from typing import Any

import click

from ivfmc_ros.cli.scans.options import catalogue_options
from ivfmc_ros.cli.scans.options import filter_of
from ivfmc_ros.cli.scans.options import filter_options
from ivfmc_ros.cli.scans.options import open_catalogue
from ivfmc_ros.cli.support.output import console
from ivfmc_ros.cli.support.output import json_option
from ivfmc_ros.cli.support.output import print_json
from ivfmc_ros.errors import ParameterError

_MM = 1e3
# With fewer values the indices say little (ISO 22514-2 asks for 125, usual are 25 or more).
_FEW = 25


@click.command()
@catalogue_options
@filter_options
@click.option(
    '-o',
    '--output',
    type=click.Path(path_type=Path),
    help='Picture of the run chart: PNG, SVG, PDF.',
)
@json_option
def statistics(root: Path, url: str, output: Path | None, as_json: bool, **options: Any) -> None:
    """
    Show mean, standard deviation, Cp and Cpk of a measured value over scans of one part.

    --part and --feature are needed; values that were not measured are counted.
    """
    from ivfmc_ros.storage.catalogue.run_chart import write_run_chart
    from ivfmc_ros.storage.catalogue.statistics import capability

    wanted = filter_of(options)
    if not (wanted.part and wanted.feature):
        raise ParameterError('--part and --feature are needed for statistics')
    found = capability(open_catalogue(root, url).find(wanted))
    if output is not None:
        write_run_chart(output, found, wanted.part)
    if as_json:
        document = asdict(found)
        print_json({**document, 'values': found.values.tolist()})
        return
    stdout = console()
    stdout.print(f'{found.feature}, {found.characteristic}: {len(found.values)} values')
    stdout.print(
        f'mean {found.mean * _MM:.4f} mm, sigma {found.sigma * _MM:.4f} mm (moving range), '
        f'{found.sigma_overall * _MM:.4f} mm (all values)'
    )
    for name, value in (
        ('Cp', found.cp),
        ('Cpk', found.cpk),
        ('Pp', found.pp),
        ('Ppk', found.ppk),
    ):
        spread = f' ± {found.cpk_95:.2f} (95 %)' if name == 'Cpk' else ''
        text = 'not determined' if math.isnan(value) else f'{value:.2f}{spread}'
        stdout.print(f'{name}: {text}')
    stdout.print(
        f'{found.failed} outside of the tolerance, {found.outside} outside of the control limits, '
        f'{found.unmeasured} not measured'
    )
    if len(found.values) < _FEW:
        stdout.print(f'few values: indices of fewer than {_FEW} say little')
    if output is not None:
        stdout.print(str(output), soft_wrap=True)
