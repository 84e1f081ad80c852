# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc calibrate noise``."""

from collections.abc import Sequence
import math
from pathlib import Path
from typing import cast

import click
import cv2
import numpy as np

from ivfmc_ros.cell.laser import Stripe
from ivfmc_ros.cli.calibrate import options
from ivfmc_ros.cli.support.output import console
from ivfmc_ros.cli.support.reconstruction_options import image_bits_option
from ivfmc_ros.image_bits import require_known_bits
from ivfmc_ros.image_bits import to_full_scale
from ivfmc_ros.model import Image
from ivfmc_ros.pictures import list_pictures
from ivfmc_ros.pictures import read_picture
from ivfmc_ros.stripe import channel as channels
from ivfmc_ros.stripe.extract import ExtractSettings
from ivfmc_ros.stripe.noise_estimate import estimate_noise
from ivfmc_ros.stripe.noise_estimate import NoiseEstimate
from ivfmc_ros.stripe.noise_file import save_noise

_PATH = click.Path(path_type=Path)
# Pictures used, spread evenly over those given.
_MAX_PICTURES = 24
# Warn if the stripe deviates from a Gaussian by more than this fraction of its height.
_MAX_SHAPE_ERROR = 0.03


@click.command()
@click.argument('pictures', nargs=-1, required=True, type=_PATH)
@click.option(
    '-o',
    '--output',
    type=_PATH,
    default=Path('noise.yaml'),
    show_default=True,
    help='File to write.',
)
@options.stripe_option
@click.option(
    '--channel', default='auto', show_default=True, help='Color channels to use, as blue+red.'
)
@image_bits_option
def noise(
    pictures: tuple[Path, ...], output: Path, stripe: Stripe, channel: str, image_bits: int
) -> None:
    """
    Estimate the noise of a camera from PICTURES of the stripe: folders or files.

    Pictures of any scan can be used; best are ten of a matt part at different table angles, so
    that each has another speckle pattern. The weight and the stated standard deviation of every
    point are computed from this noise.
    """
    settings = ExtractSettings(channel=channel, image_bits=image_bits)
    read = {str(path): read_picture(path) for path in _sample_paths(pictures)}
    require_known_bits(read.values(), image_bits)
    images = [
        _upright(to_full_scale(image, image_bits, name), stripe) for name, image in read.items()
    ]
    color = channel if channel != 'auto' else channels.unclipped_channel(images)
    gray_images = [channels.to_gray(image, color) for image in images]
    result = estimate_noise(gray_images, settings)
    save_noise(output, result.noise)
    _print_estimate(result, len(images), output)


def _sample_paths(places: Sequence[Path]) -> list[Path]:
    paths = [
        path for place in places for path in (list_pictures(place) if place.is_dir() else [place])
    ]
    chosen = np.unique(np.linspace(0, len(paths) - 1, _MAX_PICTURES).astype(int))
    return [paths[index] for index in chosen]


def _upright(image: Image, stripe: Stripe) -> Image:
    return cast(Image, cv2.transpose(image)) if stripe == 'columns' else image


def _print_estimate(result: NoiseEstimate, pictures: int, output: Path) -> None:
    model = result.noise
    stdout = console()
    shot = f'{model.electrons_per_dn:.1f}' if math.isfinite(model.electrons_per_dn) else 'no limit'
    for name, text in (
        ('read noise', f'{model.read:.2f} DN (read^2 +- {result.read_error:.2g})'),
        ('electrons per DN', f'{shot} (inverse +- {result.shot_error:.2g})'),
        ('speckle contrast', f'{model.speckle:.3f} (square +- {result.speckle_error:.2g})'),
        ('pixels', f'{result.pixels} in {pictures} pictures'),
    ):
        stdout.print(f'{name:18s} {text}')
    if result.shape > _MAX_SHAPE_ERROR:
        stdout.print(
            f'warning: the stripe is not Gaussian (it deviates by {result.shape:.1%} of its '
            'height): it saturates, or the camera sharpens the picture or is not linear; the '
            'estimated speckle contrast is too large',
        )
    stdout.print(str(output), soft_wrap=True)
