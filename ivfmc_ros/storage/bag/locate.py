# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Finds the files of a bag folder, also of a recording that was interrupted."""

from pathlib import Path
import re

from ivfmc_ros.errors import BagError
from ivfmc_ros.pictures import natural_key
from ivfmc_ros.storage.bag import decompression
from ivfmc_ros.storage.bag import metadata

# End of the name of a file that its recorder has not finished.
PART_SUFFIX = '.part'

_SUFFIX = '.mcap'
_SUFFIXES = (_SUFFIX, '.db3', '.bag')
_COMPRESSED = tuple(suffix + end for suffix in _SUFFIXES for end in decompression.SUFFIXES)
# rosbag2 names the files of a split recording <bag>_0.mcap, <bag>_1.mcap and so on.
_SPLIT_NAME = re.compile(r'(.*)_([0-9]+)((?:\.mcap|\.db3)(?:\.zstd?)?)')


def is_unfinished(file: Path) -> bool:
    """Return whether a recorder was interrupted before it finished the file."""
    return file.name.endswith(PART_SUFFIX)


def find_files(path: Path) -> tuple[tuple[Path, ...], str]:
    """
    Return the files of a bag in recording order, and a remark on what is missing, or ''.

    path : bag folder, or a file
    :raises BagError: the folder is not a bag, or it is not clear which files belong to it
    """
    if not path.is_dir():
        return (path,), _unfinished_remark(path) if is_unfinished(path) else ''
    if (path / metadata.FILE_NAME).exists():
        return tuple(metadata.bag_files(path)), ''
    file_names = _names(path)
    complete = [path / name for name in file_names if name.endswith((*_SUFFIXES, *_COMPRESSED))]
    parts = [path / name for name in file_names if name.endswith(_SUFFIX + PART_SUFFIX)]
    if not complete and len(parts) == 1:
        return tuple(parts), _unfinished_remark(parts[0])
    if not complete:
        raise metadata.not_a_bag_error(path)
    if len(complete) > 1 and not _is_split_recording(complete):
        names = ', '.join(file.name for file in complete)
        raise BagError(
            f'{path}: has no {metadata.FILE_NAME} that says which files are the bag; name one of '
            f'{names}'
        )
    names = ', '.join(file.name for file in complete)
    return tuple(complete), f'{path}: has no {metadata.FILE_NAME}; {names} is read without it'


def _unfinished_remark(file: Path) -> str:
    return f'{file}: the recording was not finished; what was written until then is read'


def _names(folder: Path) -> list[str]:
    try:
        return sorted((entry.name for entry in folder.iterdir()), key=natural_key)
    except OSError as error:
        raise BagError(f'{folder}: cannot be read: {error.strerror or error}') from error


def _is_split_recording(files: list[Path]) -> bool:
    found = [_SPLIT_NAME.fullmatch(file.name) for file in files]
    stems = {match.group(1, 3) for match in found if match}
    numbers = [int(match.group(2)) for match in found if match]
    return len(stems) == 1 and numbers == list(range(len(files)))
