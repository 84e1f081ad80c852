# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Options, console output and output files common to the calibrate commands."""

from collections.abc import Callable
from collections.abc import Iterable
from collections.abc import Mapping
from collections.abc import Sequence
import math
from pathlib import Path
from typing import Any
from typing import TYPE_CHECKING
from typing import TypeVar

import click
from rich.table import Table
from rich.text import Text

from ivfmc_ros.calibration.boards.board import Board
from ivfmc_ros.calibration.boards.board import parse_board
from ivfmc_ros.calibration.boards.board_shape import BoardShape
from ivfmc_ros.calibration.boards.markers import Markers
from ivfmc_ros.calibration.boards.markers import parse_markers
from ivfmc_ros.calibration.report import pictures_by_reason
from ivfmc_ros.cell.camera import DISTORTION_COEFFICIENTS
from ivfmc_ros.cell.cell_file import CellDraft
from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.cli.support.output import console
from ivfmc_ros.cli.support.quantities import angle
from ivfmc_ros.cli.support.quantities import length
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.pictures import list_pictures

# generic since click 8.3; click 8.1 cannot be subscripted
if TYPE_CHECKING:
    _ParamType = click.ParamType[Any]
else:
    _ParamType = click.ParamType

PATH = click.Path(path_type=Path)
_MAX_FRACTION = 0.1  # a greater relative uncertainty is a mistake in the unit
_MAX_NAMES = 4  # of pictures, printed per reason


class _ParsedType(_ParamType):
    """A click type whose text is parsed by ``parse``, which raises a ParameterError."""

    def __init__(self, name: str, parse: Callable[[str], Any]) -> None:
        self.name = name
        self._parse = parse

    def convert(self, value: Any, param: object, ctx: object) -> Any:
        return self._parse(value) if isinstance(value, str) else value


def _parse_target(text: str) -> Board | Markers:
    return parse_markers(text) if text.count(':') == 1 else parse_board(text)


def _parse_laser_words(text: str) -> tuple[str, tuple[str, ...]]:
    name, equals, words = text.partition('=')
    own = tuple(word.strip() for word in words.split(',') if word.strip())
    if not name or (equals and not own):
        raise ParameterError(f'laser: {text!r} is not understood; write NAME or NAME=WORD,WORD')
    return name, own or (name,)


def _parse_fraction(text: str) -> float:
    """Return a fraction of 1 from a percentage such as '0.02%'."""
    try:
        value = float(text.strip().removesuffix('%')) / 100.0
    except ValueError:
        value = math.nan
    if not (text.strip().endswith('%') and 0.0 <= value < _MAX_FRACTION):
        raise ParameterError(
            f'{text!r} is no uncertainty from 0% to {_MAX_FRACTION:.0%}; write e.g. 0.02%'
        )
    return value


BOARD = _ParsedType('board', parse_board)
TARGET = _ParsedType('target', _parse_target)
LASER_WORDS = _ParsedType('laser', _parse_laser_words)
FRACTION = _ParsedType('percent', _parse_fraction)
MARKERS = _ParsedType('markers', parse_markers)
LENGTH = length(1e-9)
ANGLE = angle(-math.pi, math.pi)

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
model_option = click.option(
    '--model',
    type=click.Choice(list(DISTORTION_COEFFICIENTS)),
    default='plumb_bob',
    show_default=True,
    help='Lens distortion: 5 coefficients, or 8 for wide-angle lenses.',
)
stripe_option = click.option(
    '--stripe',
    type=click.Choice(['rows', 'columns']),
    default='rows',
    show_default=True,
    help='One stripe point in every row (an upright stripe), or in every column.',
)
_temperature_option = click.option(
    '--temperature',
    type=click.FloatRange(-50.0, 100.0),
    metavar='C',
    help='Of the cell while the pictures were taken; a scan at another one is warned of.',
)
_exposure_option = click.option(
    '--exposure',
    type=click.FloatRange(1e-6, 10.0),
    metavar='SECONDS',
    help='Exposure time of the pictures with the stripe; a scan with another one is warned of.',
)
_Command = TypeVar('_Command', bound=Callable[..., Any])


def condition_options(command: _Command) -> _Command:
    """Add the options for the conditions of a calibration: temperature and exposure."""
    return _temperature_option(_exposure_option(command))


def condition_notes(temperature: float | None, exposure: float | None) -> dict[str, float]:
    """Return the notes of cell.yaml for the conditions that are known."""
    known = {'temperature_c': temperature, 'exposure': exposure}
    return {key: value for key, value in known.items() if value is not None}


pictures_argument = click.argument(
    'folders', metavar='PICTURES...', nargs=-1, required=True, type=PATH
)


def list_all_pictures(folders: Sequence[Path]) -> list[Path]:
    """
    Return the pictures of all folders.

    :raises FileError: a folder cannot be read or has no picture
    """
    return [path for folder in folders for path in list_pictures(folder)]


def where(folders: Sequence[Path]) -> str:
    """Return the names of the folders, for messages."""
    return ', '.join(map(str, folders))


def require_writable(path: Path) -> None:
    """
    Check, before the calibration runs, that a YAML file can be written there.

    :raises FileError: the folder does not exist, or the name does not end with .yaml or .yml
    """
    if not path.parent.is_dir():
        raise FileError(f'{path}: the folder {path.parent} does not exist; make it first')
    if path.suffix not in ('.yaml', '.yml'):
        raise FileError(f'{path}: the name must end with .yaml or .yml')


def load_or_new_draft(path: Path) -> CellDraft:
    """
    Return the contents of a ``cell.yaml``; an empty draft if the file does not exist.

    :raises CellError: the file cannot be read
    """
    return load_draft(path) if path.exists() else CellDraft()


def require_one_target(board: Board | None, markers: Markers | None) -> Board | Markers:
    """
    Return the target on the platter.

    :raises UsageError: neither or both of --board and --markers are given
    """
    target = board or markers
    if target is None or (board and markers):
        raise click.UsageError('Give either --board or --markers.')
    return target


def print_result(
    title: str,
    rows: Iterable[tuple[str, str]],
    warnings: Sequence[str],
    files: Sequence[Path],
    dropped: Mapping[str, str],
) -> None:
    """Print a table of results, the pictures not used, warnings, and the files written."""
    # file names may look like markup
    stdout = console()
    table = Table(title=title, show_header=False, title_justify='left')
    for name, value in rows:
        table.add_row(name, value)
    stdout.print(table)
    for reason, names in pictures_by_reason(dropped).items():
        more = f' and {len(names) - _MAX_NAMES} more' if len(names) > _MAX_NAMES else ''
        text = f'not used, {reason}: {", ".join(names[:_MAX_NAMES])}{more}'
        stdout.print(text, soft_wrap=True)
    for warning in warnings:
        stdout.print(warning_line(warning), soft_wrap=True)
    stdout.print(f'written: {", ".join(map(str, files))}', soft_wrap=True)


def print_line(text: str) -> None:
    """Print one line to stdout, without markup."""
    console().print(Text(text), soft_wrap=True)


def warning_line(text: str) -> Text:
    """Return a line that begins with a yellow 'warning:'."""
    return Text.assemble(('warning:', 'yellow'), f' {text}')


def output_files(path: Path, part: str = '') -> tuple[Path, Path, Path]:
    """
    Return the files of a calibration: YAML, figure, report.

    part : of a cell (a laser, the turntable), which has its own figure and report
    """
    named = path.with_stem(f'{path.stem}.{part}') if part else path
    return path, named.with_suffix('.png'), named.with_suffix('.report.json')


def millimeters(length: float) -> str:
    """Return a length in meters as text in millimeters."""
    return f'{length * 1e3:.3f} mm'


def board_text(board: Board, shape: BoardShape) -> str:
    """Return a board and its measured deviation from a plane as text."""
    return f'{board}, off flat by {millimeters(shape.sag(board))}'
