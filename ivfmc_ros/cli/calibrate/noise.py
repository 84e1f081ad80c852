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
from rich.console import Console

from ivfmc_ros.cell.laser import Stripe
from ivfmc_ros.model import Image
from ivfmc_ros.pictures import list_pictures
from ivfmc_ros.pictures import read_picture
from ivfmc_ros.stripe import channel as channels
from ivfmc_ros.stripe.extract import ExtractSettings
from ivfmc_ros.stripe.noise_estimate import estimate_noise
from ivfmc_ros.stripe.noise_estimate import NoiseEstimate
from ivfmc_ros.stripe.noise_file import save_noise

_PATH = click.Path(path_type=Path)
# So many pictures, spread over all, tell the noise.
_PICTURES = 24
# A stripe that differs from a bell by more than this share of its height is worth a warning.
_SHAPE = 0.03


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
@click.option(
    '--stripe',
    type=click.Choice(['rows', 'columns']),
    default='rows',
    show_default=True,
    help='One stripe point in every row (an upright stripe), or in every column.',
)
@click.option(
    '--channel', default='auto', show_default=True, help='Colours that measure, as blue+red.'
)
def noise(pictures: tuple[Path, ...], output: Path, stripe: Stripe, channel: str) -> None:
    """
    Estimate the noise of a camera from PICTURES of the stripe: folders or files.

    Any pictures of a scan will do; best are ten of a matt part that turns, so that its speckle
    is another in each. Weights and the claimed error of every point come from this noise.
    """
    settings = ExtractSettings(channel=channel)
    images = [_upright(read_picture(path), stripe) for path in _spread(pictures)]
    colour = channel if channel != 'auto' else channels.unclipped_channel(images)
    greys = [channels.to_grey(image, colour) for image in images]
    made = estimate_noise(greys, settings)
    save_noise(output, made.noise)
    _say(made, len(images), output)


def _spread(places: Sequence[Path]) -> list[Path]:
    paths = [
        path for place in places for path in (list_pictures(place) if place.is_dir() else [place])
    ]
    chosen = np.unique(np.linspace(0, len(paths) - 1, _PICTURES).astype(int))
    return [paths[index] for index in chosen]


def _upright(image: Image, stripe: Stripe) -> Image:
    return cast(Image, cv2.transpose(image)) if stripe == 'columns' else image


def _say(made: NoiseEstimate, pictures: int, output: Path) -> None:
    model = made.noise
    console = Console(markup=False)
    shot = f'{model.electrons_per_dn:.1f}' if math.isfinite(model.electrons_per_dn) else 'no limit'
    for name, text in (
        ('read noise', f'{model.read:.2f} DN (read^2 +- {made.read_error:.2g})'),
        ('electrons per DN', f'{shot} (inverse +- {made.shot_error:.2g})'),
        ('speckle contrast', f'{model.speckle:.3f} (square +- {made.speckle_error:.2g})'),
        ('pixels', f'{made.pixels} in {pictures} pictures'),
    ):
        console.print(f'{name:18s} {text}', highlight=False)
    if made.shape > _SHAPE:
        console.print(
            f'warning: the stripe is no bell (it differs by {made.shape:.1%} of its height): '
            'it saturates, or the camera sharpens or bends grey values; the speckle found '
            'contains some of that',
            highlight=False,
        )
    console.print(str(output), soft_wrap=True, highlight=False)
