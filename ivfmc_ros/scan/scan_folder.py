# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The folder of a scan: creation, job state (``job.json``), parameters (``params.yaml``), lock."""

from collections.abc import Iterator
from collections.abc import Mapping
from contextlib import contextmanager
from datetime import datetime
from datetime import UTC
import fcntl
import json
import os
from pathlib import Path
from typing import Any

import yaml

from ivfmc_ros import files
from ivfmc_ros.errors import FileError
from ivfmc_ros.scan.request import require_name
from ivfmc_ros.scan.state_machine import FINAL_STAGES
from ivfmc_ros.scan.state_machine import Stage

JOB_FILE = 'job.json'
PARAMETER_FILE = 'params.yaml'

_NODE, _VALUES = 'orchestrator', 'ros__parameters'


def create_scan_folder(root: Path, part: str, now: datetime | None = None) -> Path:
    """
    Create the folder of a new scan; its name is the scan id, such as 20261123T101500Z_bracket.

    root : folder of all scans; is created where it does not exist
    :raises ParameterError: ``part`` is not a valid name
    :raises FileError: the folder cannot be created
    """
    require_name('part', part)
    stamp = (now or datetime.now(UTC)).strftime('%Y%m%dT%H%M%SZ')
    for attempt in range(1, 1000):
        # scans of one part within one second are numbered
        name = f'{stamp}_{part}' if attempt == 1 else f'{stamp}_{part}_{attempt}'
        try:
            root.mkdir(parents=True, exist_ok=True)
            (root / name).mkdir()
        except FileExistsError:
            if not root.is_dir():
                raise FileError(f'{root}: is not a folder') from None
            continue
        except OSError as error:
            raise FileError(
                f'{root / name}: cannot be created: {error.strerror or error}'
            ) from error
        return root / name
    raise FileError(f'{root}: has 1000 scans of {part!r} of one second')


def save_job(folder: Path, document: Mapping[str, Any]) -> None:
    """
    Write the state of a scan to ``job.json`` atomically.

    :raises FileError: it cannot be written
    """
    files.write_text(folder / JOB_FILE, json.dumps(document, indent=2, allow_nan=False) + '\n')


def load_job(folder: Path) -> dict[str, Any]:
    """
    Read the state of a scan from ``job.json``.

    :raises FileError: the file does not exist, is not JSON, or has no valid stage
    """
    path = folder / JOB_FILE
    try:
        # neither a FIFO nor a device: reading one may block for ever
        if path.exists() and not path.is_file():
            raise FileError(f'{path}: is not a regular file')
        document = json.loads(path.read_text(encoding='utf-8'))
    except OSError as error:
        raise FileError(f'{path}: cannot be read: {error.strerror or error}') from error
    except ValueError as error:
        raise FileError(f'{path}: is not JSON: {error}') from error
    if not isinstance(document, dict) or document.get('stage') not in list(Stage):
        raise FileError(f'{path}: stage: is missing or unknown')
    return document


def save_parameters(folder: Path, parameters: Mapping[str, Any]) -> None:
    """
    Write the orchestrator's parameters of a scan as a ROS 2 parameter file (``--params-file``).

    :raises FileError: it cannot be written
    """
    document = {_NODE: {_VALUES: dict(parameters)}}
    files.write_text(folder / PARAMETER_FILE, yaml.safe_dump(document, sort_keys=False))


def load_parameters(folder: Path) -> dict[str, Any]:
    """
    Read the orchestrator's parameters of a scan; an empty dict where the file does not exist.

    :raises FileError: the file cannot be read, or is not a parameter file of the orchestrator
    """
    path = folder / PARAMETER_FILE
    if not path.exists():
        return {}
    try:
        document = yaml.safe_load(path.read_text(encoding='utf-8'))
        return dict(document[_NODE][_VALUES])
    except OSError as error:
        raise FileError(f'{path}: cannot be read: {error.strerror or error}') from error
    except (yaml.YAMLError, UnicodeDecodeError, KeyError, TypeError, ValueError) as error:
        raise FileError(f'{path}: has no parameters of {_NODE}: {error}') from error


@contextmanager
def lock_scan(folder: Path) -> Iterator[bool]:
    """
    Lock the folder of a scan while the block runs (advisory, ``flock``).

    Yields True; False where another process holds the lock. A file system without locks yields
    True.
    """
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        free = True
    except BlockingIOError:
        free = False
    except OSError:
        # the file system has no locks
        free = True
    try:
        yield free
    finally:
        os.close(handle)


def mark_interrupted_scans(root: Path) -> tuple[list[str], list[str]]:
    """
    Mark scans as failed whose orchestrator ended before they did.

    Scans that another process has locked are running and stay as they are.

    :returns: ids of the scans that were marked, and a message for each folder that could not be
        read or marked
    """
    marked, errors = [], []
    try:
        folders = sorted(path for path in root.iterdir() if path.is_dir())
    except OSError as error:
        return [], [f'{root}: cannot be read: {error.strerror or error}']
    for folder in folders:
        try:
            if os.path.lexists(folder / JOB_FILE) and _mark(folder):
                marked.append(folder.name)
        except FileError as error:
            errors.append(str(error))
        except OSError as error:
            errors.append(f'{folder}: cannot be read: {error.strerror or error}')
    return marked, errors


def _mark(folder: Path) -> bool:
    with lock_scan(folder) as free:
        return free and mark_scan_interrupted(folder)


def mark_scan_interrupted(folder: Path) -> bool:
    """
    Mark a scan as failed unless it has ended.

    :returns: False where it has ended, or the folder has no valid job file
    :raises FileError: the job file cannot be written
    """
    try:
        document = load_job(folder)
    except FileError:
        return False  # a job file of another program stays as it is
    if Stage(document['stage']) in FINAL_STAGES:
        return False
    reason = f'the orchestrator ended while the scan was {document["stage"]}'
    save_job(
        folder, {**document, 'stage': str(Stage.FAILED), 'code': 'INTERRUPTED', 'detail': reason}
    )
    return True
