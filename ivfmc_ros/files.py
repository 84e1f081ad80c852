# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Atomic writing of files and folders: complete under their name, or absent."""

from collections.abc import Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import shutil
import tempfile

from ivfmc_ros.errors import FileError


def _read_umask() -> int:
    umask = os.umask(0)
    os.umask(umask)
    return umask


# Read once at import: the umask can only be read by setting it, which is not thread-safe.
_UMASK = _read_umask()


@contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """
    Yield a temporary path beside ``path``, which is renamed to ``path`` when the block ends.

    If the block raises, the temporary file is removed and ``path`` is unchanged. The suffix is
    kept, because writers such as OpenCV's choose the format by it.

    :raises FileError: the folder does not exist or cannot be written
    """
    try:
        handle, name = tempfile.mkstemp(
            prefix=f'.{path.stem}-', suffix=path.suffix, dir=path.parent
        )
        os.close(handle)
    except OSError as error:
        raise FileError(f'{path}: cannot be written: {error.strerror or error}') from error
    temporary = Path(name)
    try:
        yield temporary
        # mkstemp creates with mode 0600; results get the mode of any other new file
        temporary.chmod(0o666 & ~_UMASK)
        _fsync(temporary)
        temporary.replace(path)
    except OSError as error:
        raise FileError(f'{path}: cannot be written: {error.strerror or error}') from error
    finally:
        temporary.unlink(missing_ok=True)


def require_new_folder(path: Path) -> None:
    """:raises FileError: ``path`` exists and is not an empty folder, or cannot be read."""
    try:
        taken = path.exists() and not (path.is_dir() and not any(path.iterdir()))
    except OSError as error:
        raise FileError(f'{path}: cannot be read: {error.strerror or error}') from error
    if taken:
        raise FileError(f'{path}: exists already and is not overwritten; name another folder')


@contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """
    Yield a temporary folder beside ``path``, which is renamed to ``path`` when the block ends.

    If the block raises, the temporary folder is removed. An empty folder at ``path`` is replaced.

    :raises FileError: ``path`` exists and is not an empty folder, or cannot be written
    """
    require_new_folder(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f'.{path.name}-', dir=path.parent))
    except OSError as error:
        raise FileError(f'{path}: cannot be written: {error.strerror or error}') from error
    try:
        yield temporary
        temporary.chmod(0o777 & ~_UMASK)
        temporary.replace(path)
    except OSError as error:
        raise FileError(f'{path}: cannot be written: {error.strerror or error}') from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _fsync(path: Path) -> None:
    """Flush a file to the disk before it is renamed; a power cut must not leave half of it."""
    with path.open('rb') as stream:
        os.fsync(stream.fileno())


def write_text(path: Path, text: str) -> None:
    """
    Write ``text`` to ``path`` atomically, as UTF-8.

    :raises FileError: the file cannot be written
    """
    with atomic_file(path) as temporary:
        temporary.write_text(text, encoding='utf-8')
