# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Files and folders: atomic writing, complete under their name or absent; reading that never blocks.

Also the check that a folder that a client names lies where it may.
"""

from collections.abc import Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import shutil
import stat
import tempfile

from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError

# Largest file that is read as a whole, bytes: settings and calibrations are a few kB.
MAX_TEXT_BYTES = 16 * 1024 * 1024


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


def read_bytes(path: Path, max_bytes: int = MAX_TEXT_BYTES) -> bytes:
    """
    Read a regular file as a whole.

    The path may come from a parameter: a FIFO, a device or a socket is refused without waiting
    for its other end, and a file larger than ``max_bytes`` is refused unread.

    :raises FileError: it cannot be read, is no regular file, or is larger
    """
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        with os.fdopen(handle, 'rb') as stream:
            status = os.fstat(stream.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise FileError(f'{path}: is no regular file')
            data = b'' if status.st_size > max_bytes else stream.read(max_bytes + 1)
    except OSError as error:
        raise FileError(f'{path}: cannot be read: {error.strerror or error}') from error
    except ValueError as error:  # a path with a NUL character
        raise FileError(f'{str(path)!r}: is no path: {error}') from error
    size = max(status.st_size, len(data))
    if size > max_bytes:
        raise FileError(f'{path}: has {size} bytes; at most {max_bytes} are read')
    return data


def make_folder(path: Path) -> None:
    """
    Make a folder and its parents where they do not exist.

    :raises FileError: it cannot be made
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f'{path}: cannot be made: {error.strerror or error}') from error


def folder_below(root: Path, folder: str, name: str) -> Path:
    """
    Return the absolute path of a folder that a client named, which must lie below ``root``.

    Links are followed, on both sides; the folder need not exist.

    folder : absolute, or relative to ``root``
    name : of the parameter that has it; begins the message
    :raises ParameterError: it is ``root`` itself or lies elsewhere
    """
    try:
        top = root.expanduser().resolve()
        found = (top / folder).resolve()
    except (OSError, RuntimeError, ValueError) as error:
        raise ParameterError(f'{name}: {folder!r} is no folder: {error}') from error
    if top not in found.parents:
        raise ParameterError(
            f'{name}: {folder!r} is not below {top}; the parameter scan_root of the node, set at '
            'its start, names the folder of all scans'
        )
    return found
