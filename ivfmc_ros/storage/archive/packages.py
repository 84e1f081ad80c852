# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A scan as one ZIP file with a manifest and the SHA-256 of each file, for another machine.

``manifest.json`` comes first; an import checks every file against it before the scan appears.
"""

from collections.abc import Mapping
import hashlib
import json
from pathlib import Path
from pathlib import PurePosixPath
import shutil
import tempfile
from typing import Any
from typing import IO
import zipfile

from ivfmc_ros import __version__
from ivfmc_ros import files
from ivfmc_ros.errors import FileError
from ivfmc_ros.storage.archive.rebuild import rebuild_scan
from ivfmc_ros.storage.archive.rebuild import RebuiltScan
from ivfmc_ros.storage.bag import metadata
from ivfmc_ros.storage.bag.copying import CopiedFile
from ivfmc_ros.storage.bag.copying import copy_file
from ivfmc_ros.storage.bag.copying import merged_topics
from ivfmc_ros.storage.bag.decompression import content_of
from ivfmc_ros.storage.bag.decompression import FileContent
from ivfmc_ros.storage.bag.decompression import plain_name
from ivfmc_ros.storage.bag.decompression import SUFFIXES
from ivfmc_ros.storage.bag.locate import find_files
from ivfmc_ros.storage.bag.locate import PART_SUFFIX
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.catalogue.catalogue import folder_of_cell
from ivfmc_ros.storage.catalogue.rows import ScanRow
from ivfmc_ros.storage.messages.sensor_messages import COMPRESSED_IMAGE
from ivfmc_ros.storage.messages.sensor_messages import IMAGE

MANIFEST = 'manifest.json'
# Version of the manifest.
_FORMAT = 1
# Largest manifest that is read, bytes: 100,000 files of a scan.
_MAX_MANIFEST = 32 * 1024 * 1024
_BLOCK = 1024 * 1024


def export_scan(row: ScanRow, target: Path, *, pictures: bool = True) -> Mapping[str, Any]:
    """
    Write a scan to a ZIP file, which appears when it is complete, and return its manifest.

    pictures : False: the bag is copied without the topics of images
    :raises FileError: the target exists, or a file cannot be read or written
    :raises BagError: the bag cannot be read
    """
    if target.exists():
        raise FileError(f'{target}: exists already and is not overwritten')
    if not row.folder.is_dir():
        raise FileError(f'{row.folder}: there is no such folder')
    with tempfile.TemporaryDirectory(prefix='.export-', dir=target.parent) as name:
        replaced = {} if pictures else trim_bag(row.folder, Path(name))
        sources = {**_files(row.folder), **replaced}
        if not pictures:
            # what is left of an interrupted or repaired recording has the pictures
            unwanted = (f'.mcap{PART_SUFFIX}', '.damaged', *SUFFIXES)
            sources = {key: path for key, path in sources.items() if not key.endswith(unwanted)}
        manifest = _manifest(row, sources, pictures)
        with files.atomic_file(target) as temporary:
            _write(temporary, sources, manifest)
    return manifest


def trim_bag(folder: Path, target: Path) -> dict[str, Path]:
    """
    Copy the bag of a scan without images to a folder, and return the files by name.

    :raises BagError: the bag cannot be read
    """
    paths, _ = find_files(folder)
    names = [plain_name(path).removesuffix(PART_SUFFIX) for path in paths]
    copies = [
        _copy_without_images(content_of(path), target / name)
        for path, name in zip(paths, names, strict=True)
    ]
    info = metadata.bag_information([copy.file for copy in copies], merged_topics(copies))
    document = metadata.dump({'rosbag2_bagfile_information': info})
    files.write_text(target / metadata.FILE_NAME, document)
    return {name: target / name for name in (*names, metadata.FILE_NAME)}


def _copy_without_images(source: FileContent, target: Path) -> CopiedFile:
    with source.named_errors():
        return copy_file(
            source.path,
            target,
            target.name,
            lambda _, kind: kind not in (IMAGE, COMPRESSED_IMAGE),
        )


def _files(folder: Path) -> dict[str, Path]:
    found = sorted(path for path in folder.rglob('*') if path.is_file() and not path.is_symlink())
    return {path.relative_to(folder).as_posix(): path for path in found}


def _manifest(row: ScanRow, sources: Mapping[str, Path], pictures: bool) -> dict[str, Any]:
    return {
        'format': _FORMAT,
        'ivfmc_ros': __version__,
        'scan_id': row.scan_id,
        'cell': row.cell,
        'part': row.part,
        'recipe': row.recipe,
        'created': row.created,
        'stage': row.stage,
        'code': row.code,
        'pictures': pictures,
        'files': {
            name: {'bytes': path.stat().st_size, 'sha256': _sha256(path)}
            for name, path in sources.items()
        },
    }


def _write(target: Path, sources: Mapping[str, Path], manifest: Mapping[str, Any]) -> None:
    # MCAP chunks are compressed already, and meshes as binary gain little
    with zipfile.ZipFile(target, 'w', zipfile.ZIP_STORED, allowZip64=True) as archive:
        archive.writestr(MANIFEST, json.dumps(manifest, indent=2))
        for name, path in sources.items():
            archive.write(path, name)


def import_scan(catalogue: Catalogue, source: Path) -> RebuiltScan:
    """
    Take a scan from a ZIP file into the folder of the scans and the catalogue.

    :raises FileError: the file is no export, a file differs from its hash, or the scan exists
    :raises BagError: the bag of the scan cannot be read
    """
    try:
        with zipfile.ZipFile(source) as archive:
            manifest = _read_manifest(archive, source)
            scan_id = str(manifest['scan_id'])
            target = folder_of_cell(catalogue.root, catalogue.cell) / scan_id
            if target.exists():
                raise FileError(f'{target}: exists already and is not overwritten')
            _require_no_rows(catalogue, scan_id)
            with files.atomic_folder(target) as temporary:
                for name, expected in manifest['files'].items():
                    _extract(archive, source, temporary, name, expected)
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError) as error:
        raise FileError(f'{source}: is not a ZIP file of a scan: {error}') from error
    except OSError as error:
        raise FileError(f'{source}: cannot be read: {error.strerror or error}') from error
    rebuilt = rebuild_scan(catalogue, target)
    values = {key: str(manifest[key]) for key in ('created', 'stage', 'code')}
    # a new folder: its rows are of this cell
    catalogue.update_scan(f'{catalogue.cell}/{scan_id}', **values)
    return rebuilt


def _require_no_rows(catalogue: Catalogue, scan_id: str) -> None:
    """:raises FileError: the trash has a scan of that id."""
    rows = catalogue.scans_of(scan_id)
    if any(row.deleted and row.cell == catalogue.cell for row in rows):
        raise FileError(
            f'{scan_id}: is in the trash; take it back by ivfmc scans restore, or delete it by '
            'empty-trash'
        )


def _read_manifest(archive: zipfile.ZipFile, source: Path) -> dict[str, Any]:
    try:
        if archive.getinfo(MANIFEST).file_size > _MAX_MANIFEST:
            raise FileError(f'{source}: {MANIFEST}: is too large')
        manifest = json.loads(archive.read(MANIFEST))
        version = manifest['format']
        entries = {
            str(name): (int(entry['bytes']), str(entry['sha256']))
            for name, entry in manifest['files'].items()
        }
        texts = {key: str(manifest[key]) for key in ('scan_id', 'created', 'stage', 'code')}
    except (KeyError, ValueError, TypeError, AttributeError) as error:
        raise FileError(f'{source}: has no valid {MANIFEST}: {error}') from error
    if version != _FORMAT:
        raise FileError(f'{source}: {MANIFEST}: has format {version}, known is {_FORMAT}')
    for name in (texts['scan_id'], *entries):
        _require_inside(source, name, is_flat=name == texts['scan_id'])
    return {**texts, 'files': entries}


def _require_inside(source: Path, name: str, *, is_flat: bool) -> None:
    """:raises FileError: a name would leave the folder of the scan."""
    path = PurePosixPath(name)
    is_plain = bool(name) and not path.is_absolute() and '..' not in path.parts
    if not is_plain or '\\' in name or (is_flat and (len(path.parts) != 1 or name[0] == '.')):
        raise FileError(f'{source}: {name!r} is not a name of a file inside of a scan')


def _extract(
    archive: zipfile.ZipFile, source: Path, folder: Path, name: str, expected: tuple[int, str]
) -> None:
    size, digest = expected
    target = folder / name
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        if archive.getinfo(name).file_size != size:
            raise FileError(f'{source}: {name}: has another size than {MANIFEST} states')
        with archive.open(name) as stream, target.open('wb') as copy:
            shutil.copyfileobj(stream, copy, _BLOCK)
    except KeyError:
        raise FileError(f'{source}: {name}: is missing') from None
    if _sha256(target) != digest:
        raise FileError(f'{source}: {name}: differs from its hash in {MANIFEST}')


def _sha256(path: Path) -> str:
    with path.open('rb') as stream:
        return _digest(stream)


def _digest(stream: IO[bytes]) -> str:
    hashed = hashlib.sha256()
    while block := stream.read(_BLOCK):
        hashed.update(block)
    return hashed.hexdigest()
