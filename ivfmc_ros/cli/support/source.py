# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a command reads: a bag of pictures, or a scan of the catalogue by its id."""

from collections.abc import Callable
from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import field
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
from ivfmc_ros.storage.bag.decompression import SUFFIXES
from ivfmc_ros.storage.bag.reader import Bag
from ivfmc_ros.storage.bag.reader import open_bag
from ivfmc_ros.storage.bag.topics import find_scan_topics
from ivfmc_ros.storage.bag.topics import ScanTopics
from ivfmc_ros.storage.bag.topics import type_remarks
from ivfmc_ros.storage.catalogue.database import url_of_environment
from ivfmc_ros.storage.matching.frame_matching import MatchSettings
from ivfmc_ros.storage.matching.frame_matching import MAX_EXPOSURES
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
_BAG_OPTIONS = (
    click.option(
        '--role',
        'roles',
        multiple=True,
        metavar='ROLE=TOPIC',
        help='Topic of the bag that is image, camera_info, joint_states, laser_states or profile.',
    ),
    click.option(
        '--salvage',
        is_flag=True,
        help='Use what can be read of a damaged bag; what is lost is said.',
    ),
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
    click.option(
        '--exposures',
        type=click.IntRange(1, MAX_EXPOSURES),
        help='Pictures of different exposure times at each table angle that make one profile '
        '(default: as the scan was taken).',
    ),
    click.option(
        '--received',
        is_flag=True,
        help='Use the times at which messages were recorded, where their stamps are zero or of '
        'clocks that differ.',
    ),
    click.option(
        '--table-frame',
        default='turntable',
        show_default=True,
        help='Frame that turns with the table, where the bag has tf and no joint_states.',
    ),
    scans_option,
    *_BAG_OPTIONS,
)


def source_options(command: Command) -> Command:
    """Add the options of a command that takes bags or scan ids and makes a folder."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def bag_options(command: Command) -> Command:
    """Add the options of a command that reads bags; ``BagOptions.of`` takes their values."""
    for option in reversed(_BAG_OPTIONS):
        command = option(command)
    return command


@dataclass(frozen=True, kw_only=True)
class BagOptions:
    """
    How bags are read.

    roles : topic by role, where it is not found by its name
    salvage : accept damaged bags
    exposures : images at each table angle that make one profile; None: as the scan was taken
    received : use the times of recording instead of the stamps
    table_frame : frame that turns with the table, where the bag has tf and no joint_states
    """

    roles: Mapping[str, str] = field(default_factory=dict)
    salvage: bool = False
    exposures: int | None = None
    received: bool = False
    table_frame: str = 'turntable'

    @classmethod
    def of(cls, roles: Sequence[str], salvage: bool, **others: Any) -> 'BagOptions':
        """
        Return the values of ``bag_options``; ``others`` are further fields.

        :raises ParameterError: a role has no topic
        """
        found = {}
        for item in roles:
            name, equals, value = item.partition('=')
            if not (equals and name and value):
                raise ParameterError(f'--role {item!r}: must be ROLE=TOPIC')
            found[name] = value
        return cls(roles=found, salvage=salvage, **others)


def bag_options_of(options: Mapping[str, Any]) -> BagOptions:
    """
    Return the values of ``source_options`` that say how bags are read.

    :raises ParameterError: a role has no topic
    """
    names = ('exposures', 'received', 'table_frame')
    return BagOptions.of(
        options['roles'], options['salvage'], **{name: options[name] for name in names}
    )


def bag_of(source: str) -> Path | None:
    """
    Return the bag that is meant; None for a scan id.

    :raises FileError: it can only be a bag, and there is none
    """
    bag = Path(source)
    if bag.exists():
        return bag
    # in the database of a plant, CELL/SCAN_ID is a scan
    is_path = source.count('/') > (1 if url_of_environment() else 0)
    if is_path or source.endswith(('.mcap', '.part', '.db3', '.bag', *SUFFIXES)):
        raise FileError(f'{source}: there is no such bag')
    return None


def read_bag(path: Path, options: BagOptions) -> tuple[Bag, ScanTopics]:
    """
    Open a bag and find the topics of a scan in it; what was missing is printed.

    :raises BagError: the bag is damaged, or a topic is missing
    """
    bag = open_bag(path, salvage=options.salvage)
    _warn(bag.remarks)
    topics = find_scan_topics(bag, options.roles)
    _warn(type_remarks(bag, topics, options.roles))
    return bag, topics


def read_scan(
    path: Path, cell_path: Path | None, camera_path: Path | None, options: BagOptions
) -> tuple[ScanBag, Cell]:
    """
    Return the pictures of a bag, and the cell that took them; what was missing is printed.

    cell_path, camera_path : to use instead of what lies beside the bag, and in it
    :raises ParameterError: there is no cell.yaml
    """
    folder = path if path.is_dir() else path.parent
    cell_file = cell_path or folder / 'cell.yaml'
    if cell_path is None and not cell_file.is_file():
        raise ParameterError('--cell cell.yaml is needed: there is none beside the bag')
    draft = load_draft(cell_file)
    parameters = load_parameters(folder)
    scan = open_scan(
        path,
        joint=draft.turntable.joint if draft.turntable else 'turntable_joint',
        lasers=[laser.name for laser in draft.lasers],
        camera=None if camera_path is None else load_camera(camera_path),
        topics=options.roles,
        taken=MatchSettings(
            dark=bool(parameters.get('dark_frames')),
            exposures=options.exposures or int(parameters.get('exposures', 1)),
        ),
        salvage=options.salvage,
        received=options.received,
        table_frame=options.table_frame,
    )
    _warn(scan.remarks)
    return scan, draft.complete(scan.camera, str(cell_file))


def _warn(remarks: Sequence[str]) -> None:
    for remark in remarks:
        click.echo(f'ivfmc: warning: {remark}', err=True)
