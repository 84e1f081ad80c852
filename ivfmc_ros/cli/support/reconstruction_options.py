# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Options of the reconstruction: bag to mesh; lengths in mm unless a unit is given."""

from collections.abc import Callable
from pathlib import Path
from typing import Any
from typing import TypeVar

import click

from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.cli.support.quantities import length
from ivfmc_ros.image_bits import UNKNOWN
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

image_bits_option = click.option(
    '--image-bits',
    type=int,
    default=UNKNOWN,
    help='Significant bits of 16-bit pictures, such as 12.  [default: pictures that look like '
    'fewer bits are refused]',
)

_OPTIONS = (
    click.option('--radius', type=length(1e-4, 10.0), default='60mm', show_default=True,
                 help='Radius of the working volume about the table axis.'),
    click.option('--bottom', type=length(-1.0, 10.0), default='0mm', show_default=True,
                 help='Height above the platter where the working volume begins.'),
    click.option('--top', type=length(-1.0, 10.0), default='100mm', show_default=True,
                 help='Height above the platter where the working volume ends.'),
    click.option('--method', default='auto', show_default=True,
                 type=click.Choice(['auto', *STRIPE_METHODS]),
                 help='Estimator of the stripe position in each row.'),
    click.option('--channel', default='auto', show_default=True,
                 help='Color channels that measure the stripe, such as red or blue+red; auto '
                      'takes those that do not saturate.'),
    image_bits_option,
    click.option('--max-uncertainty', type=float, default=0.3, show_default=True,
                 help='Drop stripe points whose position has a larger standard uncertainty, as '
                      'a fraction of the stripe width; smaller values give cleaner edges.'),
    click.option('--space-time', type=int, default=0, show_default=True, metavar='PICTURES',
                 help='Space-time analysis over this many pictures before and after: cleaner '
                      'edges and changes of color where angle steps are small. 0: off.'),
    click.option('--noise', type=click.Path(path_type=Path),
                 help='noise.yaml of the camera.  [default: that of the bench cell]'),
    click.option('--min-contrast', type=float, default=0.01, show_default=True,
                 help='Smallest height of the stripe above its background, share of full scale.'),
    click.option('--noise-distance', type=length(1e-6, 1.0), default='2mm', show_default=True,
                 help='Largest distance between neighbors on the stripe that are one surface.'),
    click.option('--island', type=int, default=100, show_default=True, metavar='POINTS',
                 help='Connected components of a view with fewer points are dropped.'),
    click.option('--registration', type=click.Choice(METHODS), default='joint',
                 show_default=True, help='Registration method.'),
    click.option('--refine', 'refine', type=click.Choice(REFINABLE), multiple=True,
                 help='Self-calibration: what of the cell is estimated; the corrected cell.yaml '
                      'is written beside the mesh. May be repeated.'),
    click.option('--max-edge', type=length(0.0),
                 help='Longest edge of a triangle.  [default: 5 point spacings]'),
    click.option('--mesh', 'mesh_method', type=click.Choice(MESH_METHODS), default='integrate',
                 show_default=True, help='Meshing method.'),
    click.option('--close', type=click.Choice(CLOSINGS), default='none', show_default=True,
                 help='What is filled where nothing was measured; such triangles are marked.'),
    click.option('--voxel', type=length(0.0),
                 help='Edge of a voxel of the mesh.  [default: 0.6 point spacings]'),
    click.option('--smoothing', type=int, default=6, show_default=True, metavar='ROUNDS',
                 help='Rounds of bilateral normal filtering of the mesh.'),
    click.option('--decimate', type=length(0.0), default='0mm', show_default=True,
                 help='Largest deviation of the decimated mesh; 0: by --decimate-sigmas.'),
    click.option('--decimate-sigmas', type=click.FloatRange(0.0, 100.0), default=0.0,
                 show_default=True,
                 help='Largest deviation of the decimated mesh in median standard deviations of '
                      'the points, such as 0.25, until two triangles a point are left; 0: none.'),
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
        radius=options['radius'],
        bottom=options['bottom'],
        top=options['top'],
    )
    extract = ExtractSettings(
        method=options['method'],
        channel=options['channel'],
        image_bits=options['image_bits'],
        max_uncertainty=options['max_uncertainty'],
        noise=None if options['noise'] is None else load_noise(options['noise']),
        min_contrast=options['min_contrast'],
    )
    return Settings(
        acquisition=AcquisitionSettings(
            extract=extract,
            volume=volume,
            noise_distance=options['noise_distance'],
            space_time=options['space_time'],
        ),
        island_least=options['island'],
        registration=options['registration'],
        mesh=_mesh(options),
        refine=tuple(options['refine']),
        export_unit=options['unit'],
    )


def _mesh(options: dict[str, Any]) -> MeshSettings:
    return MeshSettings(
        method=options['mesh_method'],
        max_edge=options['max_edge'],
        close=options['close'],
        voxel=options['voxel'],
        smoothing=options['smoothing'],
        decimate=options['decimate'],
        decimate_sigmas=options['decimate_sigmas'],
    )
