# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a command rebuilds: a bag of pictures, or a scan of the catalogue by its id."""

from collections.abc import Callable
from pathlib import Path
from typing import Any
from typing import TypeVar

import click

from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.scan.scan_folder import load_parameters
from ivfmc_ros.storage.scans.scan_bag import open_scan
from ivfmc_ros.storage.scans.scan_bag import ScanBag

Command = TypeVar('Command', bound=Callable[..., Any])

scans_option = click.option(
    '--scans',
    'root',
    type=click.Path(path_type=Path),
    default=Path('ivfmc_run') / 'scans',
    show_default=True,
    help='Folder of the scans, where a scan id is looked for.',
)
_OPTIONS = (
    click.option(
        '--cell',
        'cell_path',
        type=click.Path(path_type=Path),
        help='cell.yaml: lasers and turntable (default: the one beside the bag of a scan).',
    ),
    click.option(
        '-o',
        '--output',
        type=click.Path(path_type=Path),
        required=True,
        help='Folder to make; must not exist yet.',
    ),
    scans_option,
)


def source_options(command: Command) -> Command:
    """Add the options of a command that takes bags or scan ids and makes a folder."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def bag_of(source: str) -> Path | None:
    """
    Return the bag that is meant; None for a scan id.

    :raises FileError: it can only be a bag, and there is none
    """
    bag = Path(source)
    if bag.exists():
        return bag
    if '/' in source or source.endswith('.mcap'):
        raise FileError(f'{source}: there is no such bag')
    return None


def open_bag(bag: Path, cell_path: Path | None, camera_path: Path | None) -> tuple[ScanBag, Cell]:
    """
    Return the pictures of a bag, and the cell that took them.

    cell_path, camera_path : to use instead of what lies beside the bag, and in it
    :raises ParameterError: there is no cell.yaml
    """
    folder = bag if bag.is_dir() else bag.parent
    path = cell_path or folder / 'cell.yaml'
    if cell_path is None and not path.is_file():
        raise ParameterError('--cell cell.yaml is needed: there is none beside the bag')
    draft = load_draft(path)
    camera = None if camera_path is None else load_camera(camera_path)
    names = [laser.name for laser in draft.lasers]
    dark = bool(load_parameters(folder).get('dark_frames'))
    scan = open_scan(bag, lasers=names, camera=camera, dark=dark)
    return scan, draft.complete(scan.camera, str(path))
