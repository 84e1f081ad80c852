# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the calibrate commands have in common: options, tables, files beside the YAML."""

from collections.abc import Callable
from collections.abc import Iterable
from collections.abc import Mapping
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.table import Table
from rich.text import Text

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board import parse_board
from ivfmc_ros.calibration.boards.board import parse_length
from ivfmc_ros.calibration.boards.markers import Markers
from ivfmc_ros.calibration.boards.markers import parse_markers
from ivfmc_ros.calibration.report import reasons
from ivfmc_ros.cell.cell_file import CellDraft
from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.errors import FileError
from ivfmc_ros.pictures import list_pictures

# click 8.3 made it generic, 8.1 cannot be subscripted
if TYPE_CHECKING:
    _ParamType = click.ParamType[Any]
else:
    _ParamType = click.ParamType

PATH = click.Path(path_type=Path)
_LISTED = 4


class _Text(_ParamType):
    """A parameter that ``parse`` reads; what it raises is a ParameterError."""

    def __init__(self, name: str, parse: Callable[[str], Any]) -> None:
        self.name = name
        self._parse = parse

    def convert(self, value: Any, param: object, ctx: object) -> Any:
        return self._parse(value) if isinstance(value, str) else value


BOARD = _Text('board', parse_board)
MARKERS = _Text('markers', parse_markers)
LENGTH = _Text('length', lambda text: parse_length(text, 'length'))

camera_option = click.option(
    '--camera', 'camera_file', required=True, type=PATH, help='camera.yaml of the camera.'
)
cell_option = click.option(
    '--cell', 'cell_file', required=True, type=PATH, help='cell.yaml to make or to add to.'
)
board_option = click.option(
    '--board',
    required=True,
    type=BOARD,
    metavar='BOARD',
    help='chessboard:8x6:40mm (inner corners, side of a square) or '
    'charuco:10x7:12mm:9mm:DICT_4X4_50 (squares, sides of square and marker, dictionary).',
)
pictures_argument = click.argument(
    'folders', metavar='PICTURES...', nargs=-1, required=True, type=PATH
)


def all_pictures(folders: Sequence[Path]) -> list[Path]:
    """
    Return the pictures of all folders.

    :raises FileError: one of them has none
    """
    return [path for folder in folders for path in list_pictures(folder)]


def where(folders: Sequence[Path]) -> str:
    """Return how messages name the folders."""
    return ', '.join(map(str, folders))


def require_target(path: Path) -> None:
    """:raises FileError: nothing can be written there; found out before the work is done."""
    if not path.parent.is_dir():
        raise FileError(f'{path}: the folder {path.parent} does not exist; make it first')
    if path.suffix not in ('.yaml', '.yml'):
        raise FileError(f'{path}: name a .yaml file')


def draft_of(path: Path) -> CellDraft:
    """
    Return what ``cell.yaml`` holds so far; nothing if there is none.

    :raises CellError: it cannot be read
    """
    return load_draft(path) if path.exists() else CellDraft()


def one_target(board: Board | None, markers: Markers | None) -> Board | Markers:
    """Return what lies on the platter: one of the two must be given."""
    target = board or markers
    if target is None or (board and markers):
        raise click.UsageError('Give either --board or --markers.')
    return target


def say(
    title: str,
    rows: Iterable[tuple[str, str]],
    warnings: Sequence[str],
    files: Sequence[Path],
    dropped: Mapping[str, str],
) -> None:
    """Print a table of results, what to mind, and where the files are."""
    # names of files may look like markup
    console = Console(markup=False)
    table = Table(title=title, show_header=False, title_justify='left')
    for name, value in rows:
        table.add_row(name, value)
    console.print(table)
    for reason, names in reasons(dropped).items():
        more = f' and {len(names) - _LISTED} more' if len(names) > _LISTED else ''
        text = f'not used, {reason}: {", ".join(names[:_LISTED])}{more}'
        console.print(text, soft_wrap=True, highlight=False)
    for warning in warnings:
        console.print(warned(warning), soft_wrap=True, highlight=False)
    console.print(f'written: {", ".join(map(str, files))}', soft_wrap=True, highlight=False)


def warned(text: str) -> Text:
    """Return a line that warns."""
    return Text.assemble(('warning:', 'yellow'), f' {text}')


def files_of(path: Path, part: str = '') -> tuple[Path, Path, Path]:
    """
    Return the files of a calibration: itself, picture, and the name that gives the report's.

    part : of a cell, whose parts have pictures and reports of their own
    """
    named = path.with_stem(f'{path.stem}.{part}') if part else path
    return path, named.with_suffix('.png'), named.with_suffix('.report.json')


def millimetres(length: float) -> str:
    """Return a length in metres as text."""
    return f'{length * 1e3:.3f} mm'
