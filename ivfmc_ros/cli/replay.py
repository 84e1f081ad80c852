# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc replay``: publishes the inputs of a bag to the nodes, then registers and meshes."""

from collections.abc import Collection
from collections.abc import Iterable
from collections.abc import Iterator
from collections.abc import Sequence
import contextlib
from contextlib import contextmanager
from pathlib import Path
import shutil
import time
from typing import Any

import click

from ivfmc_ros import files
from ivfmc_ros.cli.support.bag_player import BagPlayer
from ivfmc_ros.cli.support.bag_player import OWN_VIEWS
from ivfmc_ros.cli.support.bag_player import target_of
from ivfmc_ros.cli.support.bag_player import Track
from ivfmc_ros.cli.support.cell_run import NAMESPACE
from ivfmc_ros.cli.support.cell_run import namespace_of
from ivfmc_ros.cli.support.client import cell_client
from ivfmc_ros.cli.support.client import CellClient
from ivfmc_ros.cli.support.output import console
from ivfmc_ros.cli.support.progress import progress_bars
from ivfmc_ros.cli.support.source import bag_options
from ivfmc_ros.cli.support.source import BagOptions
from ivfmc_ros.cli.support.source import read_bag
from ivfmc_ros.errors import BagError
from ivfmc_ros.errors import FileError
from ivfmc_ros.scan.request import MOTIONS
from ivfmc_ros.scan.scan_folder import load_parameters
from ivfmc_ros.storage.bag.reader import Bag
from ivfmc_ros.storage.bag.topics import ScanTopics
from ivfmc_ros.storage.messages.profile_header import ProfileHeader
from ivfmc_ros.storage.scans.scan_messages import is_transforms
from ivfmc_ros.storage.scans.scan_messages import recorded_profile_headers

_PATH = click.Path(path_type=Path)
_REGISTER_S = 1800.0
_TIMED = ('triangulator', 'registrar', 'mesher')


@click.command()
@click.argument('bag', type=_PATH)
@click.option(
    '--rate',
    type=click.FloatRange(0.0, 1000.0),
    default=0.0,
    show_default=True,
    help='Factor of the recorded speed; 0: as fast as the nodes process.',
)
@click.option('-o', '--output', type=_PATH, help='Folder to make for the mesh files.')
@click.option('--clock', is_flag=True, help='Publish /clock, and set use_sim_time of the nodes.')
@bag_options
@click.option(
    '--topic',
    'others',
    multiple=True,
    metavar='TOPIC[=NAME]',
    help='Publish this topic of the bag as well, as NAME if given.',
)
@click.option(
    '--motion',
    type=click.Choice(MOTIONS),
    help='How the table turned; matches every picture again instead of using recorded profiles.',
)
@click.option('--wait', default=20.0, show_default=True, help='Seconds to wait for subscribers.')
@click.option('--build/--no-build', default=True, help='Register and mesh at the end.')
@click.option('--namespace', default=NAMESPACE, show_default=True, help='Name of the cell.')
def replay(bag: Path, namespace: str, **options: Any) -> None:
    """Publish the pictures, camera, table and lasers of BAG; start 'ivfmc up --replay' first."""
    output: Path | None = options['output']
    if output is not None:
        files.require_new_folder(output)
    opened, roles = read_bag(bag, BagOptions.of(options['roles'], options['salvage']))
    if is_transforms(roles.joint_states):
        raise BagError(
            f'{bag}: has transforms and no joint_states, which the nodes need; '
            '`ivfmc reconstruct` reads it'
        )
    tracks = _tracks(opened, roles, options['others'])
    # the views of a recorded scan, and nothing else, are its views again
    profile = None if options['motion'] else roles.profile
    recorded = recorded_profile_headers(opened, profile.name) if profile else {}
    dark = bool(load_parameters(bag if bag.is_dir() else bag.parent).get('dark_frames'))
    with cell_client(namespace_of(namespace)) as client:
        player = BagPlayer(client, opened, tracks, options['clock'], recorded, every=dark)
        player.await_listeners(options['wait'])
        with _clock_of(client, options['clock']):
            _prepare(client, roles, options['motion'] or motion_of(recorded.values()), dark)
            total = sum(opened.topics[name].count for name in tracks)
            with progress_bars() as progress:
                player.play(options['rate'], lambda done: progress('messages', done, total))
        stdout = console()
        stdout.print(f'{player.pictures} pictures became {player.profiles} profiles')
        if options['build']:
            for line in _build(client, output, player.profiles):
                stdout.print(line, soft_wrap=True)


def _tracks(bag: Bag, roles: ScanTopics, others: Sequence[str]) -> dict[str, Track]:
    named = {
        'image_raw': roles.image,
        'camera_info': roles.camera_info,
        'joint_states': roles.joint_states,
        'laser_states': roles.laser_states,
    }
    tracks = {
        topic.name: target_of(bag, topic.name, target, target == 'image_raw')
        for target, topic in named.items()
        if topic is not None
    }
    for item in others:
        source, _, target = item.partition('=')
        tracks.setdefault(source, target_of(bag, source, target or source))
    return tracks


@contextmanager
def _clock_of(client: CellClient, simulated: bool) -> Iterator[None]:
    """Set use_sim_time for the block: /clock stands still when it is no longer published."""
    try:
        for node in _TIMED if simulated else ():
            client.set_parameters(node, {'use_sim_time': True})
        yield
    finally:
        for node in _TIMED if simulated else ():
            client.set_parameters(node, {'use_sim_time': False})


def motion_of(recorded: Collection[ProfileHeader]) -> str | None:
    """Return how the table turned while profiles were taken; None where there are none."""
    if not recorded:
        return None
    return 'continuous' if any(head.speed for head in recorded) else 'step'


def _prepare(client: CellClient, roles: ScanTopics, motion: str | None, dark: bool) -> None:
    """Reset the nodes, and set the parameters that follow from the bag."""
    name = f'replay_{time.time_ns()}'
    source = 'always_on' if roles.laser_states is None else 'topic'
    values: dict[str, Any] = {
        'scan_id': name,
        'laser_source': source,
        'view': OWN_VIEWS,
        'subtract_dark': dark,
    }
    if motion:
        values['motion'] = motion
    client.set_parameters('triangulator', values)
    client.set_parameters('registrar', {'scan_id': name, 'expected': 0})
    client.trigger('registrar/reset')
    # the same bag has the same stamps: without a new scan_id the mesher would keep old views
    client.set_parameters('mesher', {'scan_id': name})


def _build(client: CellClient, output: Path | None, profiles: int) -> list[str]:
    """Register and mesh, move the mesh files to ``output``, and return the lines to print."""
    # a node writes below its scan_root only
    folder = '' if output is None else f'.replay_{time.time_ns()}'
    client.set_parameters('mesher', {'scan_folder': folder})
    client.set_parameters('registrar', {'expected': profiles})
    try:
        registered = client.trigger('registrar/register', _REGISTER_S)
        built = client.trigger('mesher/build', _REGISTER_S)
    finally:
        client.set_parameters('mesher', {'scan_folder': ''})
    if output is not None:
        _move(built['paths'].values(), output)
    lines = [f'{key}: {value}' for key, value in registered.items() if _short(key, value)]
    return lines + [f'{key}: {value}' for key, value in built.items() if _short(key, value)]


def _move(paths: Iterable[str], output: Path) -> None:
    """
    Move the files that the mesher wrote to a new folder, and remove theirs.

    :raises FileError: they are not on this computer, or the folder cannot be made
    """
    sources = [Path(path) for path in paths]
    with files.atomic_folder(output) as folder:
        for path in sources:
            try:
                shutil.move(path, folder / path.name)
            except OSError as error:
                raise FileError(
                    f'{path}: written by the mesher, cannot be moved to {output}: '
                    f'{error.strerror or error}'
                ) from error
    for parent in {path.parent for path in sources}:
        with contextlib.suppress(OSError):
            parent.rmdir()


def _short(key: str, value: Any) -> bool:
    return key != 'code' and not isinstance(value, list | dict)
