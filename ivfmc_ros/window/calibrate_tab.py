# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The tab that guides the taking of pictures of a board, judged one by one."""

from datetime import datetime
from datetime import UTC
from html import escape
from pathlib import Path
import threading
from typing import Any

import cv2

from ivfmc_ros import files
from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board import Corners
from ivfmc_ros.calibration.boards.board import find_corners
from ivfmc_ros.calibration.boards.board import parse_board
from ivfmc_ros.calibration.boards.views import BoardView
from ivfmc_ros.calibration.boards.views import BoardViews
from ivfmc_ros.calibration.camera.calibrate import calibrate_camera
from ivfmc_ros.calibration.camera.calibrate import MIN_VIEWS
from ivfmc_ros.calibration.live.guide import CaptureGuide
from ivfmc_ros.calibration.live.picture import picture_quality
from ivfmc_ros.calibration.live.proposal import propose
from ivfmc_ros.errors import ScanError
from ivfmc_ros.model import Image
from ivfmc_ros.window.guide_drawing import picture_svg
from ivfmc_ros.window.guide_drawing import residual_svg
from ivfmc_ros.window.guide_drawing import volume_svg

_DEFAULT = 'charuco:10x7:12mm:9mm:DICT_4X4_50'
_TOLD = 4  # of what is missing


class CalibrateTab:
    """
    Guides pictures of a board, as ``ivfmc calibrate live`` does, and keeps those that help.

    From 6 pictures on the camera is calibrated after each one, to show the residuals at once.

    active : pictures are wanted
    """

    def __init__(self, gui: Any, root: Path) -> None:
        """
        Add the elements to the container that is open in ``gui``.

        root : folder in which a folder is made for each set of pictures
        """
        self._root = root
        self._board: Board | None = None
        self._guide: CaptureGuide | None = None
        self._folder: Path | None = None
        # good pictures and the corners in them
        self._kept: list[BoardView] = []
        # finding a board takes longer than a picture period: one at a time
        self._busy = threading.Lock()
        self._text = gui.add_text('Board', _DEFAULT, hint='As in ivfmc calibrate --board.')
        self._on = gui.add_checkbox('Take pictures of the board', False)
        self._said = gui.add_html(
            '<p>Hold the board in front of the camera. Pictures that add something are kept.</p>'
        )
        self._picture = gui.add_html('')
        self._missing = gui.add_html('')
        self._volume = gui.add_html('')
        self._residuals = gui.add_html('')
        self._on.on_update(lambda _: self._begin())

    @property
    def active(self) -> bool:
        """Whether pictures are wanted."""
        return bool(self._on.value)

    def judge(self, image: Image) -> None:
        """Judge a picture in the calling thread; does nothing while another one is judged."""
        if not self.active or not self._busy.acquire(blocking=False):
            return
        try:
            self._judge(image)
        except ScanError as error:
            self._say(str(error))
        finally:
            self._busy.release()

    def _begin(self) -> None:
        if not self.active:
            # what was found stays
            return
        self._guide = self._folder = None
        self._kept = []
        for element in (self._picture, self._missing, self._volume, self._residuals):
            element.content = ''
        try:
            self._board = parse_board(str(self._text.value))
        except ScanError as error:
            self._on.value = False
            self._say(str(error))

    def _judge(self, image: Image) -> None:
        if self._board is None:
            return
        height, width = image.shape[:2]
        guide = self._guide
        if guide is None or guide.size != (width, height):
            guide = self._guide = CaptureGuide(self._board, (width, height))
            self._kept = []
            self._show_missing()
        corners = find_corners(self._board, image)
        self._picture.content = picture_svg(guide, propose(guide), image, corners)
        if corners is None:
            self._say('the board is not detected; show all of it')
            return
        faults = picture_quality(self._board, corners, image).faults()
        if not faults:
            self._guide, reason = guide.add(corners)
            faults = (reason,) if reason else ()
        if faults:
            self._say('; '.join(faults))
            return
        path = self._keep(image, corners)
        self._say(f'good: {path.name}')
        self._show_missing()
        self._show_residuals()

    def _keep(self, image: Image, corners: Corners) -> Path:
        """Write a picture; :raises FileError: it cannot be written."""
        now = datetime.now(UTC)
        if self._folder is None:
            self._folder = self._root / f'{now:%Y%m%dT%H%M%SZ}'
        files.make_folder(self._folder)
        path = self._folder / f'board_{now:%H%M%S_%f}.png'
        with files.atomic_file(path) as temporary:
            temporary.write_bytes(cv2.imencode('.png', image)[1].tobytes())
        self._kept.append(BoardView(path=path, corners=corners))
        return path

    def _show_missing(self) -> None:
        guide = self._guide
        if guide is None:
            return
        if guide.is_complete:
            self._on.value = False
            text = (
                '<p><b>The set is complete.</b> Now run: <code>ivfmc calibrate camera '
                f'{escape(str(self._folder))} --board {escape(str(self._text.value))}</code></p>'
            )
        else:
            lines = ''.join(f'<li>{escape(line)}</li>' for line in guide.missing()[:_TOLD])
            text = f'<p>Next, as the board is drawn:</p><ol>{lines}</ol>'
        count = len(guide.views)
        self._missing.content = f'<p>{count} pictures, {guide.coverage:.0%} of the image</p>{text}'
        self._volume.content = volume_svg(guide)

    def _show_residuals(self) -> None:
        """Calibrate the camera by the pictures so far; a set that is too poor says why."""
        board, guide = self._board, self._guide
        if board is None or guide is None or len(self._kept) < MIN_VIEWS:
            return
        views = BoardViews(found=tuple(self._kept), missed=(), size=guide.size)
        try:
            result = calibrate_camera(board, views, where='the pictures so far')
        except ScanError as error:
            self._residuals.content = f'<p>no residuals yet: {escape(str(error))}</p>'
            return
        focal, std = result.camera.K[0, 0], result.std['fx']
        self._residuals.content = (
            f'{residual_svg(result)}<p>focal length {focal:.1f} px, 1 sigma {std:.1f} px</p>'
        )

    def _say(self, text: str) -> None:
        self._said.content = f'<p role="status" aria-live="polite">{escape(text)}</p>'
