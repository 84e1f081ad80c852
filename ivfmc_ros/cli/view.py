# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc view``: a mesh, a scan or a bag in the 3-D view of the work window, without a graph."""

from pathlib import Path
import webbrowser

import click

from ivfmc_ros.cell.camera_file import load_camera
from ivfmc_ros.cell.cell_file import load_cell
from ivfmc_ros.cli.support.output import console
from ivfmc_ros.cli.up import interrupted
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.inspection.mesh_file import SUFFIXES
from ivfmc_ros.meshing.io.export import UNITS
from ivfmc_ros.scan.scan_folder import load_parameters
from ivfmc_ros.storage.bag.reader import Bag
from ivfmc_ros.storage.bag.reader import open_bag
from ivfmc_ros.storage.messages.point_clouds import to_profile
from ivfmc_ros.window.access import Access
from ivfmc_ros.window.drawn import DrawnPoints
from ivfmc_ros.window.mesh_files import compare
from ivfmc_ros.window.mesh_files import load_mesh
from ivfmc_ros.window.page import ViewPage

_PATH = click.Path(path_type=Path)
_MESHES = ('mesh.ply', 'mesh.stl')
_RADIUS, _TOP = 0.06, 0.1
_PROFILE = 'profile'


@click.command()
@click.argument('path', metavar='PATH', type=_PATH)
@click.option(
    '--unit',
    type=click.Choice(UNITS),
    help='Of a mesh file (default: mm, or that of the scan).',
)
@click.option('--nominal', type=_PATH, help='Mesh to color the distance from, in the same frame.')
@click.option('--nominal-unit', type=click.Choice(UNITS), default='mm', show_default=True)
@click.option('--port', type=click.IntRange(0, 65535), default=0, help='0: a free one.')
@click.option('--no-browser', is_flag=True, help='Only print the address.')
def view(
    path: Path,
    unit: str | None,
    nominal: Path | None,
    nominal_unit: str,
    port: int,
    no_browser: bool,
) -> None:
    """
    Show PATH in a browser of this computer until Ctrl-C.

    PATH is a mesh file, the folder of a scan (its mesh and its cell), or a bag with profiles.
    """
    mesh = _mesh_of(path)
    bag = None if mesh is not None else open_bag(path)
    if nominal is not None and mesh is None:
        raise ParameterError(f'--nominal: {path} has no mesh to compare')
    with interrupted() as ending:
        page = ViewPage(path.name or str(path), '127.0.0.1', port, Access(), console().print)
        try:
            _show_cell(page, path if path.is_dir() else path.parent)
            if mesh is not None:
                found_unit = unit or _unit_of(path)
                page.show_mesh(
                    load_mesh(mesh, found_unit)
                    if nominal is None
                    else compare(mesh, found_unit, nominal, nominal_unit)
                )
            elif bag is not None:
                _show_profiles(page, bag)
            address = f'http://127.0.0.1:{page.port}'
            console().print(f'{address}: {mesh or path}; Ctrl-C ends it')
            if not no_browser:
                webbrowser.open(address)
            ending.wait()
        finally:
            page.close()


def _mesh_of(path: Path) -> Path | None:
    """Return the mesh file that PATH is, or has; None where it may be a bag."""
    if path.suffix.lower() in SUFFIXES:
        return path
    if not path.exists():
        raise FileError(f'{path}: file not found')
    found = (path / name for name in _MESHES)
    return next((file for file in found if file.is_file()), None)


def _unit_of(path: Path) -> str:
    """Return the unit of the mesh in a scan folder, mm elsewhere."""
    return str(load_parameters(path).get('export_unit', 'mm')) if path.is_dir() else 'mm'


def _show_cell(page: ViewPage, folder: Path) -> None:
    """Draw the cell of a scan folder, if it is one."""
    cell, camera = folder / 'cell.yaml', folder / 'camera.yaml'
    if cell.is_file() and camera.is_file():
        page.scene.show_cell(load_cell(cell, load_camera(camera)), _RADIUS, _TOP)


def _show_profiles(page: ViewPage, bag: Bag) -> None:
    """:raises FileError: the bag has no profiles."""
    topics = [name for name in bag.topics if name.rpartition('/')[2] == _PROFILE]
    if not topics:
        raise FileError(
            f'{bag.path}: has no topic {_PROFILE}; make a mesh of its pictures by '
            '`ivfmc reconstruct`'
        )
    decode = bag.decoder(topics[0])
    for raw in bag.messages(topics[:1]):
        profile = to_profile(decode(raw), f'{bag.path}: {topics[0]}')
        if len(profile):
            page.scene.add_profile(DrawnPoints.of_profile(profile))
    page.scene.flush()
