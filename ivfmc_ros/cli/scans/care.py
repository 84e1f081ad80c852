# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc scans verify``, ``repair`` and ``rebuild``."""

from collections.abc import Iterator
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict
from dataclasses import dataclass
import json
from pathlib import Path
from typing import Any

import click
import yaml

from ivfmc_ros import files
from ivfmc_ros.cli.scans.options import catalogue_options
from ivfmc_ros.cli.scans.options import open_catalogue
from ivfmc_ros.cli.support.output import console
from ivfmc_ros.cli.support.output import json_option
from ivfmc_ros.cli.support.output import print_json
from ivfmc_ros.errors import CatalogueError
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.scan.scan_folder import load_parameters
from ivfmc_ros.storage.archive.rebuild import cell_folders
from ivfmc_ros.storage.archive.rebuild import rebuild_scan
from ivfmc_ros.storage.archive.rebuild import scan_folders
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.catalogue.catalogue import FILE_NAME
from ivfmc_ros.storage.catalogue.catalogue import folder_of_cell
from ivfmc_ros.storage.catalogue.database import cell_of_environment
from ivfmc_ros.storage.repair import check_recording
from ivfmc_ros.storage.repair import RecordingCheck
from ivfmc_ros.storage.repair import repair_recording
from ivfmc_ros.storage.repair.missing_profiles import ProfilePlace

# Profiles that a repair could not recover, beside the bag.
LOST_FILE = 'lost.json'

# Exit code where a recording is damaged or incomplete.
_NOT_SOUND = 3

_sources = click.argument('sources', metavar='[SCAN_ID|BAG]...', nargs=-1)


@click.command()
@_sources
@catalogue_options
@json_option
def verify(sources: tuple[str, ...], root: Path, url: str, as_json: bool) -> None:
    """
    Check recordings: every CRC, index, metadata.yaml, and what is missing.

    Without a source, all scans of the folder are checked. The exit code is 3 if one is damaged or
    incomplete.
    """
    is_sound = True
    documents = []
    for recording in _recordings(sources, root, url):
        check = check_recording(recording.path, **_expected(recording, url))
        is_sound &= check.is_sound and check.is_complete
        documents.append(_document(check))
        if not as_json:
            _say(check)
    if as_json:
        print_json(documents)
    if not is_sound:
        raise click.exceptions.Exit(_NOT_SOUND)


@click.command()
@_sources
@catalogue_options
@json_option
def repair(sources: tuple[str, ...], root: Path, url: str, as_json: bool) -> None:
    """
    Repair recordings that were interrupted or damaged: every intact chunk, index, metadata.yaml.

    The original is kept beside the repaired file. The rows of the catalogue are written anew.
    """
    if not sources:
        raise click.UsageError('name the recordings to repair: SCAN_ID or BAG')
    documents = []
    for recording in _recordings(sources, root, url):
        path = recording.path
        expected = _expected(recording, url)
        repaired = repair_recording(path, **expected)
        if repaired.written and path.is_dir():
            _save_lost(path, repaired.before, expected['acknowledged'])
        rows = _rebuild_rows(recording, url) if repaired.written else ''
        documents.append(
            {
                **_document(repaired.before),
                'written': [str(file) for file in repaired.written],
                'kept': [str(file) for file in repaired.kept],
                'catalogue': rows,
            }
        )
        if not as_json:
            _say(repaired.before)
            for text in (
                *(f'written: {file}' for file in repaired.written),
                *(f'kept: {file}' for file in repaired.kept),
                rows,
            ):
                console().print(f'  {text}', soft_wrap=True)
    if as_json:
        print_json(documents)


@click.command()
@click.argument('scan_ids', metavar='[SCAN_ID]...', nargs=-1)
@catalogue_options
@json_option
def rebuild(scan_ids: tuple[str, ...], root: Path, url: str, as_json: bool) -> None:
    """
    Write the rows of scans into the catalogue anew, from their folders alone.

    Without a scan id, all scans of the folder are taken. A catalogue that cannot be read is kept
    as catalogue.sqlite3.damaged.
    """
    documents, failed = [], []
    for cell, folder in _folders_to_rebuild(scan_ids, root, url):
        catalogue = _fresh_catalogue(folder.parent, url, cell)
        try:
            made = rebuild_scan(catalogue, folder)
        except ScanError as error:
            failed.append(str(error))
            click.echo(f'ivfmc: warning: {error}', err=True)
            continue
        finally:
            catalogue.close()
        documents.append(asdict(made))
        if not as_json:
            console().print(
                f'{made.scan_id}: {made.profiles} profiles, {made.results} results, '
                f'{made.inspections} inspections'
            )
    if as_json:
        print_json(documents)
    if failed:
        count = len(failed) + len(documents)
        raise FileError(f'{len(failed)} of {count} scans could not be rebuilt')


def _folders_to_rebuild(scan_ids: tuple[str, ...], root: Path, url: str) -> list[tuple[str, Path]]:
    """Return cell and folder of the scans that are meant; all of them without ids."""
    cell = cell_of_environment(url)
    own = folder_of_cell(root, cell)
    if scan_ids:
        return [(cell, _named_folder(own, name)) for name in scan_ids]
    return [
        (name, folder)
        for name, folder_of_scans in cell_folders(root, cell)
        for folder in scan_folders(folder_of_scans)
    ]


def _named_folder(root: Path, name: str) -> Path:
    """:raises FileError: the name leads to another place."""
    if Path(name).name != name or name == '..':
        raise FileError(f'{name}: is not the name of a folder in {root}')
    return root / name


def _fresh_catalogue(root: Path, url: str, cell: str) -> Catalogue:
    try:
        return open_catalogue(root, url, create=True, cell=cell)
    except CatalogueError as error:
        path = root / FILE_NAME
        if url or 'not a database' not in str(error):
            raise
        path.replace(path.with_name(f'{FILE_NAME}.damaged'))
        click.echo(f'ivfmc: warning: {error}; kept as {FILE_NAME}.damaged', err=True)
        return open_catalogue(root, url, create=True, cell=cell)


@dataclass(frozen=True)
class _Recording:
    """A recording; ``cell`` is the cell of its rows, None where it is not known."""

    path: Path
    cell: str | None = None


def _recordings(sources: tuple[str, ...], root: Path, url: str) -> Iterator[_Recording]:
    """Yield the recordings that are meant: a path, or the folder of a scan."""
    cell = cell_of_environment(url)
    if not sources:
        for name, folder in cell_folders(root, cell):
            yield from (_Recording(path, name) for path in scan_folders(folder))
    for source in sources:
        own = folder_of_cell(root, cell) / source
        if Path(source).exists():
            yield _Recording(Path(source), _cell_of(Path(source).absolute(), root, url))
        elif own.is_dir():
            yield _Recording(own, cell)
        else:
            row = open_catalogue(root, url).scan(source)
            yield _Recording(row.folder, row.cell)


def _cell_of(path: Path, root: Path, url: str) -> str | None:
    """Return the cell that has a folder as one of its scans."""
    cells = cell_folders(root.absolute(), cell_of_environment(url))
    return next((cell for cell, folder in cells if folder == path.parent), None)


def _expected(recording: _Recording, url: str) -> dict[str, Any]:
    """Return what is known of a scan beside its bag: profiles of the catalogue, planned views."""
    path = recording.path
    profiles: dict[int, ProfilePlace] = dict(_load_lost(path))
    # a bag that is no scan, or whose catalogue is lost, has no rows
    with suppress(CatalogueError):
        catalogue = open_catalogue(path.absolute().parent, url, cell=recording.cell)
        name = f'{catalogue.cell}/{path.name}' if url else path.name
        profiles |= {row.seq: row for row in catalogue.profiles(name)}
        catalogue.close()
    return {'acknowledged': profiles, 'planned_views': _planned_views(path)}


@dataclass(frozen=True)
class _LostProfile:
    """A profile that a repair could not recover; angle in radians."""

    view: int
    angle: float


def _save_lost(
    folder: Path, check: RecordingCheck, acknowledged: Mapping[int, ProfilePlace]
) -> None:
    """Write the profiles that are lost beside the bag: the rows that named them are replaced."""
    found = {seq for file in check.files for seq in file.profiles}
    lost = {
        str(seq): {'view': place.view, 'angle': place.angle}
        for seq, place in sorted(acknowledged.items())
        if seq not in found
    }
    files.write_text(folder / LOST_FILE, json.dumps({'profiles': lost}, indent=2) + '\n')


def _load_lost(folder: Path) -> dict[int, _LostProfile]:
    try:
        document = json.loads(files.read_bytes(folder / LOST_FILE))
        return {
            int(seq): _LostProfile(int(entry['view']), float(entry['angle']))
            for seq, entry in document['profiles'].items()
        }
    except (FileError, ValueError, KeyError, TypeError, AttributeError):
        return {}


def _planned_views(folder: Path) -> int:
    """Return the number of views that the parameters of a scan ask for, 0 where unknown."""
    try:
        parameters = load_parameters(folder)
        cell = yaml.safe_load(files.read_bytes(folder / 'cell.yaml'))
        lasers = len(parameters.get('lasers') or cell['lasers'])
        return int(parameters['views']) * lasers
    except (FileError, yaml.YAMLError, KeyError, TypeError, ValueError):
        return 0


def _rebuild_rows(recording: _Recording, url: str) -> str:
    """Write the rows of a repaired scan anew: the chunks are at other places now."""
    path = recording.path.absolute()
    # in the database of a plant, rows of a folder elsewhere would be those of a scan without files
    is_scan = recording.cell is not None if url else (path.parent / FILE_NAME).exists()
    if not path.is_dir() or not is_scan:
        return 'catalogue: has no rows of it'
    made = rebuild_scan(open_catalogue(path.parent, url, cell=recording.cell), path)
    return f'catalogue: {made.profiles} profiles'


def _document(check: RecordingCheck) -> dict[str, Any]:
    return {
        'path': str(check.path),
        'sound': check.is_sound,
        'complete': check.is_complete,
        'messages': check.messages,
        'lost': check.lost,
        'missing': [asdict(run) for run in check.missing],
        'missing_views': list(check.missing_views),
        'damaged': [
            {'file': str(file.path), **asdict(part)}
            for file in check.files
            for part in file.damaged
        ],
        'findings': check.lines(),
    }


def _say(check: RecordingCheck) -> None:
    state = 'sound' if check.is_sound else 'damaged'
    state += ', complete' if check.is_complete else ', incomplete'
    count = sum(check.messages.values())
    stdout = console()
    stdout.print(f'{check.path}: {state}, {count} messages can be read', soft_wrap=True)
    for line in check.lines():
        stdout.print(f'  {line}', soft_wrap=True)
