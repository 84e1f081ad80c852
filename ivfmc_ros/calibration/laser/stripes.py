# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The part of the laser stripe that lies on the board."""

from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.camera.board_poses import Placed
from ivfmc_ros.calibration.laser.paper_mask import Paper
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.laser import Stripe as Direction
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image
from ivfmc_ros.stripe import channel
from ivfmc_ros.stripe.extract import extract
from ivfmc_ros.stripe.extract import ExtractSettings
from ivfmc_ros.stripe.extract import Stripe
from ivfmc_ros.stripe.region import Region

# The stripe is taken up to this many squares beyond the outermost corners, if it goes straight.
MARGIN = 3.5
_MIN_POINTS = 20
_TRIALS = 200
# How far from a straight line, pixels, the stripe on a board may be: a bent one is no line.
_STRAIGHT = 2.0
_OUTLIER = 3.5
# Half the window of the top-hat: pixels to try, then sigmas of the stripe that was found.
_FIRST_REACHES = (20, 10)
_REACH_SIGMAS = 3.5
# Paper must be white this many pixels along the stripe.
_CLEAR_ALONG = 2
# The stripe's background is no darker than this share of the paper's brightness, which is this
# percentile of what may be white.
_DARK = 0.45
_PAPER = 80.0
# Pixels between those whose place on the board is worked out.
_COARSE = 2


@dataclass(frozen=True, eq=False, kw_only=True)
class BoardStripe:
    """
    Stripe points on one board.

    uv : (n, 2) pixel
    sigma : pixel, 1 sigma of a point, from how far the points are from a smooth curve
    width : (n,) pixel, 1 sigma of the stripe's Gaussian
    """

    uv: Floats
    sigma: float
    width: Floats

    def __len__(self) -> int:
        return len(self.uv)


def white_region(
    board: Board, placed: Placed, paper: Paper, rays: Floats, margin: float = MARGIN
) -> Bools:
    """
    Return the pixels that show white paper of a board or what is around it.

    rays : (height, width, 3) of every pixel
    margin : squares around the outermost corners
    returns : (height, width) bool, to two pixels
    """
    coarse = rays[::_COARSE, ::_COARSE]
    corners = board.corners_xyz[:, :2]
    low = corners.min(axis=0) - margin * board.square
    high = corners.max(axis=0) + margin * board.square
    xy = placed.to_board(placed.intersect(coarse.reshape(-1, 3)))[:, :2]
    inside = ((xy >= low) & (xy <= high)).all(axis=1)
    inside[inside] = paper.is_white(xy[inside])
    fine = np.kron(inside.reshape(coarse.shape[:2]), np.ones((_COARSE, _COARSE), dtype=bool))
    return np.asarray(fine[: rays.shape[0], : rays.shape[1]])


def stripe_on_board(
    image: Image, white: Bools, camera: Camera, stripe: Direction, settings: ExtractSettings
) -> BoardStripe | None:
    """
    Find the stripe where it lies on the white of a board.

    Black print moves the centre of a stripe that straddles its edge, so only points are kept
    that have white paper all around. The wall behind carries the stripe too, on another line.

    white : (height, width) bool, from ``white_region``
    returns : None if there is no straight stripe of at least 20 points
    """
    grey = channel.to_grey(image, settings.channel)
    candidates = [
        _straight(_on_bright_ground(grey, white, stripe, settings, reach), camera, stripe)
        for reach in _FIRST_REACHES
    ]
    # of two lines the one with more light: a strip of paper between dark ones is fainter
    light, best = max(candidates, key=lambda candidate: candidate[0])
    return best if light > 0 else None


def _straight(
    found: Stripe, camera: Camera, stripe: Direction
) -> tuple[float, BoardStripe | None]:
    """Return the light (sum of heights) on the straightest part of a stripe, and that part."""
    if len(found) < _MIN_POINTS:
        return 0.0, None
    # along the stripe, and across it, in pixels; lens distortion bends what is straight
    flat = camera.rays(found.uv)[:, :2] * camera.K[[0, 1], [0, 1]]
    across, along = flat.T if stripe == 'rows' else flat.T[::-1]
    keep, sigma = _smooth_curve(along, across)
    if keep.sum() < _MIN_POINTS:
        return 0.0, None
    stripe_found = BoardStripe(uv=found.uv[keep], sigma=sigma, width=found.width[keep])
    return float(found.intensity[keep].sum()), stripe_found


def _on_bright_ground(
    grey: Image, white: Bools, stripe: Direction, settings: ExtractSettings, reach: int
) -> Stripe:
    """
    Extract a stripe from paper that is nearly as bright as the stripe.

    A white top-hat across the stripe leaves what is narrower than its window (Serra 1982); the
    window is fitted to the stripe that a first, wide one finds. All of the window must be white.

    reach : pixels, half the first window
    """
    found = _with_window(grey, white, stripe, settings, reach)
    if len(found) < _MIN_POINTS:
        return found
    fitted = int(np.ceil(_REACH_SIGMAS * np.median(found.width))) + 2
    return _with_window(grey, white, stripe, settings, fitted)


def _with_window(
    grey: Image, white: Bools, stripe: Direction, settings: ExtractSettings, reach: int
) -> Stripe:
    across, along = 2 * reach + 1, 2 * _CLEAR_ALONG + 1
    height, width = (1, across) if stripe == 'rows' else (across, 1)
    hat = cv2.morphologyEx(grey, cv2.MORPH_TOPHAT, np.ones((height, width), dtype=np.uint8))
    clear = np.ones((along, across) if stripe == 'rows' else (across, along), dtype=np.uint8)
    mask = cv2.erode(white.astype(np.uint8), clear) > 0
    found = extract(cast(Image, hat), stripe, settings, Region.of(mask))
    return _on_paper(found, grey, cast(Image, hat), white)


def _on_paper(found: Stripe, grey: Image, hat: Image, white: Bools) -> Stripe:
    """
    Leave out what does not stand on paper.

    A strip of paper between dark ones stands out of its surroundings as a stripe does, but these
    are dark.
    """
    if len(found) == 0:
        return found
    paper = float(np.percentile(grey[white], _PAPER))
    column, row = found.uv.round().astype(np.int64).T
    ground = grey[row, column].astype(np.float64) - hat[row, column]
    return found[ground >= _DARK * paper]


def _smooth_curve(along: Floats, across: Floats) -> tuple[Bools, float]:
    """
    Find the points on one nearly straight curve: RANSAC line, then a robust parabola.

    returns : (n,) bool, and the robust standard deviation of the kept points from the curve
    """
    keep = _ransac_line(along, across)
    sigma = 0.0
    for _ in range(5):
        if keep.sum() < _MIN_POINTS:
            break
        curve = np.polynomial.Polynomial.fit(along[keep], across[keep], 2)
        off = np.abs(across - curve(along))
        sigma = max(1.4826 * float(np.median(off[keep])), 0.01)
        inside = (along >= along[keep].min()) & (along <= along[keep].max())
        keep = (off < _OUTLIER * sigma) & inside
    return keep, sigma


def _ransac_line(along: Floats, across: Floats) -> Bools:
    rng = np.random.default_rng(0)
    best = np.zeros(len(along), dtype=bool)
    for _ in range(_TRIALS):
        i, j = rng.choice(len(along), 2, replace=False)
        if along[i] == along[j]:
            continue
        slope = (across[j] - across[i]) / (along[j] - along[i])
        near = np.abs(across - across[i] - slope * (along - along[i])) < _STRAIGHT
        if near.sum() > best.sum():
            best = near
    return best
