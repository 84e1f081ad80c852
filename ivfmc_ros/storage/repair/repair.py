# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Repairs a recording that was interrupted or damaged: all intact chunks, a new index, metadata.yaml.

The messages are copied to a new file, which gets its name when it is complete. The original stays
beside it: ``scan.mcap.damaged``, or ``scan.mcap.part`` of a recording that was not finished. Files
that were compressed as a whole become plain ones, all of a bag: metadata.yaml has one compression.
"""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
import fcntl
import os
from pathlib import Path

from ivfmc_ros import files
from ivfmc_ros.errors import FileError
from ivfmc_ros.storage.bag import mcap_file
from ivfmc_ros.storage.bag import metadata
from ivfmc_ros.storage.bag.copying import CopiedFile
from ivfmc_ros.storage.bag.copying import copy_file
from ivfmc_ros.storage.bag.copying import describe_file
from ivfmc_ros.storage.bag.copying import merged_topics
from ivfmc_ros.storage.bag.decompression import is_compressed
from ivfmc_ros.storage.bag.decompression import plain_name
from ivfmc_ros.storage.bag.locate import is_unfinished
from ivfmc_ros.storage.bag.locate import PART_SUFFIX
from ivfmc_ros.storage.bag.reader import format_of
from ivfmc_ros.storage.repair.check import check_recording
from ivfmc_ros.storage.repair.check import FileCheck
from ivfmc_ros.storage.repair.check import RecordingCheck
from ivfmc_ros.storage.repair.missing_profiles import ProfilePlace

DAMAGED_SUFFIX = '.damaged'


@dataclass(frozen=True, kw_only=True)
class RepairedRecording:
    """
    Result of a repair.

    before : what was found
    written : files that were written, none where the recording was sound
    kept : the originals of the files that were replaced
    """

    before: RecordingCheck
    written: tuple[Path, ...]
    kept: tuple[Path, ...]


def repair_recording(
    path: Path,
    acknowledged: Mapping[int, ProfilePlace] | None = None,
    planned_views: int = 0,
) -> RepairedRecording:
    """
    Repair a recording; a sound one is left as it is.

    path : bag folder, folder of a scan, or MCAP file
    acknowledged, planned_views : as in ``check_recording``
    :raises BagError: there is no recording, or a file cannot be read
    :raises FileError: the recording is still running, or a file cannot be written
    """
    check = check_recording(path, acknowledged, planned_views)
    if check.is_sound:
        return RepairedRecording(before=check, written=(), kept=())
    for file in check.files:
        _require_mcap(file)
        _require_ended(file.path)
    written: list[Path] = []
    kept: list[Path] = []
    copies = []
    for file in check.files:
        is_left = file.is_sound and not is_compressed(file.path)
        copies.append(describe_file(file.path) if is_left else _copy(file, written, kept))
    if path.is_dir() or any(is_unfinished(file.path) for file in check.files):
        _write_metadata(written, kept, path if path.is_dir() else path.parent, copies)
    return RepairedRecording(before=check, written=tuple(written), kept=tuple(kept))


def _require_mcap(file: FileCheck) -> None:
    """:raises FileError: a file is of a format that is only read."""
    if format_of(file.content.path) is not mcap_file:
        raise FileError(
            f'{file.path}: only MCAP is repaired; ivfmc reconstruct --salvage reads what is '
            'intact, ros2 bag reindex writes metadata.yaml'
        )


def _require_ended(file: Path) -> None:
    """:raises FileError: the recorder of a file still runs."""
    try:
        with file.open('rb') as stream:
            fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        raise FileError(f'{file}: is being recorded; stop the recorder before a repair') from None
    except OSError:
        # the file system has no locks
        return


def _copy(check: FileCheck, written: list[Path], kept: list[Path]) -> CopiedFile:
    """Write a file with the intact messages of another one, which is kept."""
    source = check.path
    target = source.with_name(plain_name(source).removesuffix(PART_SUFFIX))
    if target != source and target.exists():
        raise FileError(f'{target}: exists already and is not overwritten')
    with files.atomic_file(target) as temporary:
        copy = copy_file(check.content.path, temporary, target.name)
        kept.append(_keep(source) if target == source else source)
    written.append(target)
    return copy


def _keep(original: Path) -> Path:
    """Give a file a second name, so that it stays when the first one is replaced."""
    for number in range(1, 1000):
        name = f'{original.name}{DAMAGED_SUFFIX}{"" if number == 1 else f".{number}"}'
        kept = original.with_name(name)
        try:
            os.link(original, kept)
        except FileExistsError:
            continue
        except OSError as error:
            raise FileError(f'{kept}: cannot be made: {error.strerror or error}') from error
        return kept
    raise FileError(f'{original}: has 1000 damaged copies; remove some')


def _write_metadata(
    written: list[Path], kept: list[Path], folder: Path, copies: Sequence[CopiedFile]
) -> None:
    info = metadata.bag_information([copy.file for copy in copies], merged_topics(copies))
    path = folder / metadata.FILE_NAME
    if path.exists():
        kept.append(_keep(path))
    files.write_text(path, metadata.dump({'rosbag2_bagfile_information': info}))
    written.append(path)
