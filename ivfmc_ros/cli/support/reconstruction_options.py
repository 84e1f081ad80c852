# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Options that say how a scan is reconstructed, in the units that people measure in."""

from collections.abc import Callable
from pathlib import Path
from typing import Any
from typing import TypeVar

import click

from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.meshing.io.export import UNITS
from ivfmc_ros.meshing.settings import CLOSINGS
from ivfmc_ros.meshing.settings import MeshSettings
from ivfmc_ros.meshing.settings import METHODS as MESH_METHODS
from ivfmc_ros.pipeline import Settings
from ivfmc_ros.registration.align import METHODS
from ivfmc_ros.registration.self_calibration.parameters import REFINABLE
from ivfmc_ros.stripe.acquisition import AcquisitionSettings
from ivfmc_ros.stripe.estimators import METHODS as STRIPE_METHODS
from ivfmc_ros.stripe.extract import ExtractSettings
from ivfmc_ros.stripe.noise_file import load_noise

Command = TypeVar('Command', bound=Callable[..., Any])

_MM = 1e-3

_OPTIONS = (
    click.option('--radius', type=float, default=60.0, show_default=True, metavar='MM',
                 help='Radius of the working volume about the table axis.'),
    click.option('--bottom', type=float, default=0.0, show_default=True, metavar='MM',
                 help='Height above the platter where the working volume begins.'),
    click.option('--top', type=float, default=100.0, show_default=True, metavar='MM',
                 help='Height above the platter where the working volume ends.'),
    click.option('--method', default='auto', show_default=True,
                 type=click.Choice(['auto', *STRIPE_METHODS]),
                 help='How the place of the stripe is estimated.'),
    click.option('--channel', default='auto', show_default=True,
                 help='Colours that measure the stripe, such as red or blue+red; auto takes '
                      'those that do not saturate.'),
    click.option('--max-doubt', type=float, default=0.3, show_default=True,
                 help='A stripe point whose place is in doubt by more than this share of the '
                      "stripe's width is dropped; less keeps edges cleaner."),
    click.option('--space-time', type=int, default=0, show_default=True, metavar='PICTURES',
                 help='Follow each point through so many pictures before and after: cleaner edges '
                      'and changes of colour where angle steps are dense. 0 for none.'),
    click.option('--noise', type=click.Path(path_type=Path),
                 help='noise.yaml of the camera.  [default: that of the bench cell]'),
    click.option('--min-contrast', type=float, default=0.01, show_default=True,
                 help='Least height of the stripe above its background, share of full scale.'),
    click.option('--noise-distance', type=float, default=2.0, show_default=True, metavar='MM',
                 help='Neighbours on the stripe farther apart than this are not one surface.'),
    click.option('--island', type=int, default=100, show_default=True, metavar='POINTS',
                 help='A piece of surface with fewer points is noise.'),
    click.option('--registration', type=click.Choice(METHODS), default='joint',
                 show_default=True, help='How views are brought together.'),
    click.option('--refine', 'refine', type=click.Choice(REFINABLE), multiple=True,
                 help='What of the cell the scan may correct; the corrected cell.yaml lies '
                      'beside the mesh. Repeatable.'),
    click.option('--max-edge', type=float, metavar='MM',
                 help='Longest edge of a triangle.  [default: 5 point spacings]'),
    click.option('--mesh', 'mesh_method', type=click.Choice(MESH_METHODS), default='integrate',
                 show_default=True, help='How views become a mesh.'),
    click.option('--close', type=click.Choice(CLOSINGS), default='none', show_default=True,
                 help='What is invented where nothing was seen; such triangles are marked.'),
    click.option('--voxel', type=float, metavar='MM',
                 help='Edge of a voxel of the mesh.  [default: the point spacing]'),
    click.option('--smoothing', type=int, default=6, show_default=True, metavar='ROUNDS',
                 help='Rounds of bilateral normal filtering of the mesh.'),
    click.option('--decimate', type=float, default=0.0, show_default=True, metavar='MM',
                 help='Simplify the mesh by as much as it may deviate; 0 keeps all triangles.'),
    click.option('--unit', type=click.Choice(list(UNITS)), default='mm', show_default=True,
                 help='Unit of the mesh files.'),
)  # fmt: skip


def reconstruction_options(command: Command) -> Command:
    """Add the options to a command; ``settings_of`` turns their values into settings."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def settings_of(options: dict[str, Any]) -> Settings:
    """
    Return the settings that the options ask for.

    :raises ParameterError: a value is out of range
    """
    volume = Volume(
        radius=options['radius'] * _MM,
        bottom=options['bottom'] * _MM,
        top=options['top'] * _MM,
    )
    extract = ExtractSettings(
        method=options['method'],
        channel=options['channel'],
        max_doubt=options['max_doubt'],
        noise=None if options['noise'] is None else load_noise(options['noise']),
        min_contrast=options['min_contrast'],
    )
    return Settings(
        acquisition=AcquisitionSettings(
            extract=extract,
            volume=volume,
            noise_distance=options['noise_distance'] * _MM,
            space_time=options['space_time'],
        ),
        island_least=options['island'],
        registration=options['registration'],
        mesh=_mesh(options),
        refine=tuple(options['refine']),
        export_unit=options['unit'],
    )


def _mesh(options: dict[str, Any]) -> MeshSettings:
    voxel, max_edge = options['voxel'], options['max_edge']
    return MeshSettings(
        method=options['mesh_method'],
        max_edge=None if max_edge is None else max_edge * _MM,
        close=options['close'],
        voxel=None if voxel is None else voxel * _MM,
        smoothing=options['smoothing'],
        decimate=options['decimate'] * _MM,
    )
