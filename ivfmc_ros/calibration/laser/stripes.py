# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Extraction of the laser stripe where it lies on the white paper of a board or a platter."""

from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.camera.board_poses import BoardPose
from ivfmc_ros.calibration.laser.paper_mask import PaperMask
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.laser import Stripe as Direction
from ivfmc_ros.image_bits import to_full_scale
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Image
from ivfmc_ros.stripe import channel
from ivfmc_ros.stripe.extract import extract
from ivfmc_ros.stripe.extract import ExtractSettings
from ivfmc_ros.stripe.extract import Stripe
from ivfmc_ros.stripe.roi import RegionOfInterest

# Squares beyond the outermost corners where the stripe is used, as far as it is straight.
MARGIN = 3.5
_MIN_POINTS = 20  # of a stripe
_TRIALS = 200  # of RANSAC
# Greatest distance in pixels of inliers from a straight line; allows for a bent board.
_RANSAC_DISTANCE = 2.0
_OUTLIER = 3.5  # robust sigmas from the parabola
# Half window of the top-hat transform: pixels for the first extraction, then sigmas of the
# stripe that it found.
_INITIAL_HALF_WINDOWS = (20, 10)
_HALF_WINDOW_SIGMAS = 3.5
# Pixels along the stripe within which the paper must be white.
_ERODE_ALONG = 2
# Least brightness of the stripe's background as a fraction of the paper's; the paper's
# brightness is this percentile of the pixels of the white mask.
_MIN_BACKGROUND = 0.45
_PAPER_PERCENTILE = 80.0
# Only every second pixel is projected on the board: the mask has this resolution.
_GRID_STEP = 2


@dataclass(frozen=True, eq=False, kw_only=True)
class BoardStripe:
    """
    Stripe points on one board.

    uv : (n, 2) pixel
    sigma : pixel, 1 sigma of a point, estimated from the residuals of a smooth curve
    width : (n,) pixel, 1 sigma of the stripe's Gaussian profile
    """

    uv: Floats
    sigma: float
    width: Floats

    def __len__(self) -> int:
        return len(self.uv)


def white_mask(
    board: Board, board_pose: BoardPose, mask: PaperMask, rays: Floats, margin: float = MARGIN
) -> Bools:
    """
    Return the pixels that show white paper of a board, or its surroundings within a margin.

    rays : (height, width, 3) rays of all pixels
    margin : squares around the outermost corners
    returns : (height, width) bool, with a resolution of two pixels
    """
    coarse = rays[::_GRID_STEP, ::_GRID_STEP]
    corners = board.corners_xyz[:, :2]
    low = corners.min(axis=0) - margin * board.square
    high = corners.max(axis=0) + margin * board.square
    xy = board_pose.to_board(board_pose.intersect(coarse.reshape(-1, 3)))[:, :2]
    inside = ((xy >= low) & (xy <= high)).all(axis=1)
    inside[inside] = mask.is_white(xy[inside])
    fine = np.kron(inside.reshape(coarse.shape[:2]), np.ones((_GRID_STEP, _GRID_STEP), dtype=bool))
    return np.asarray(fine[: rays.shape[0], : rays.shape[1]])


def extract_board_stripe(
    image: Image, white: Bools, camera: Camera, stripe: Direction, settings: ExtractSettings
) -> BoardStripe | None:
    """
    Extract the stripe where it lies on white paper.

    Black print displaces the center of a stripe near its edge: only points surrounded by white
    paper are used. The stripe on the background is on another line and is rejected by RANSAC.

    white : (height, width) bool, from ``white_mask``
    returns : None without a straight stripe of at least 20 points
    """
    image = to_full_scale(image, settings.image_bits, 'the picture')
    gray = channel.to_gray(image, settings.channel)
    candidates = [
        _straightest_stripe(
            _extract_on_paper(gray, white, stripe, settings, half_window), camera, stripe
        )
        for half_window in _INITIAL_HALF_WINDOWS
    ]
    # take the brighter of two lines: a strip of paper between dark ones is fainter than the stripe
    light, best = max(candidates, key=lambda candidate: candidate[0])
    return best if light > 0 else None


def _straightest_stripe(
    found: Stripe, camera: Camera, stripe: Direction
) -> tuple[float, BoardStripe | None]:
    """Return the sum of the peak heights of the straightest part of a stripe, and that part."""
    if len(found) < _MIN_POINTS:
        return 0.0, None
    # undistorted, in pixels: lens distortion bends a straight stripe
    undistorted = camera.rays(found.uv)[:, :2] * camera.K[[0, 1], [0, 1]]
    across, along = undistorted.T if stripe == 'rows' else undistorted.T[::-1]
    keep, sigma = _fit_curve(along, across)
    if keep.sum() < _MIN_POINTS:
        return 0.0, None
    board_stripe = BoardStripe(uv=found.uv[keep], sigma=sigma, width=found.width[keep])
    return float(found.intensity[keep].sum()), board_stripe


def _extract_on_paper(
    gray: Image, white: Bools, stripe: Direction, settings: ExtractSettings, half_window: int
) -> Stripe:
    """
    Extract a stripe from paper that is nearly as bright as the stripe.

    The white top-hat transform across the stripe keeps structures narrower than its window
    (Serra 1982). The window is first wide, then adapted to the width of the stripe found. The
    whole window must lie on white paper.

    half_window : pixels, of the first extraction
    """
    found = _extract_top_hat(gray, white, stripe, settings, half_window)
    if len(found) < _MIN_POINTS:
        return found
    fitted = int(np.ceil(_HALF_WINDOW_SIGMAS * np.median(found.width))) + 2
    return _extract_top_hat(gray, white, stripe, settings, fitted)


def _extract_top_hat(
    gray: Image, white: Bools, stripe: Direction, settings: ExtractSettings, half_window: int
) -> Stripe:
    across, along = 2 * half_window + 1, 2 * _ERODE_ALONG + 1
    height, width = (1, across) if stripe == 'rows' else (across, 1)
    hat = cv2.morphologyEx(gray, cv2.MORPH_TOPHAT, np.ones((height, width), dtype=np.uint8))
    clear = np.ones((along, across) if stripe == 'rows' else (across, along), dtype=np.uint8)
    mask = cv2.erode(white.astype(np.uint8), clear) > 0
    found = extract(cast(Image, hat), stripe, settings, RegionOfInterest.of(mask))
    return _drop_dark_background(found, gray, cast(Image, hat), white)


def _drop_dark_background(found: Stripe, gray: Image, hat: Image, white: Bools) -> Stripe:
    """
    Remove points whose background is darker than paper.

    A strip of paper between dark ones passes the top-hat as a stripe does, but its background
    is dark.
    """
    if len(found) == 0:
        return found
    paper = float(np.percentile(gray[white], _PAPER_PERCENTILE))
    column, row = found.uv.round().astype(np.int64).T
    ground = gray[row, column].astype(np.float64) - hat[row, column]
    return found[ground >= _MIN_BACKGROUND * paper]


def _fit_curve(along: Floats, across: Floats) -> tuple[Bools, float]:
    """
    Select the points on one nearly straight curve: RANSAC line, then a robust parabola.

    returns : (n,) bool, and the robust standard deviation of the inliers from the curve, pixel
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
        near = np.abs(across - across[i] - slope * (along - along[i])) < _RANSAC_DISTANCE
        if near.sum() > best.sum():
            best = near
    return best
