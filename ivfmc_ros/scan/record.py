# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The folder of a scan, and the file in it that says how far the job is."""

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
from ivfmc_ros.scan.machine import ENDS
from ivfmc_ros.scan.machine import Stage
from ivfmc_ros.scan.request import require_name

JOB = 'job.json'
PARAMETERS = 'params.yaml'

_NODE, _VALUES = 'orchestrator', 'ros__parameters'


def new_folder(root: Path, part: str, now: datetime | None = None) -> Path:
    """
    Make the folder of a new scan; its name is the scan's id, such as 20261123T101500Z_bracket.

    :raises ParameterError: the part's name is not usable as a name
    :raises FileError: the folder cannot be made
    """
    require_name('part', part)
    stamp = (now or datetime.now(UTC)).strftime('%Y%m%dT%H%M%SZ')
    for attempt in range(1, 1000):
        # two scans in one second are two scans
        name = f'{stamp}_{part}' if attempt == 1 else f'{stamp}_{part}_{attempt}'
        try:
            root.mkdir(parents=True, exist_ok=True)
            (root / name).mkdir()
        except FileExistsError:
            if not root.is_dir():
                raise FileError(f'{root}: is not a folder') from None
            continue
        except OSError as error:
            raise FileError(f'{root / name}: cannot be made: {error.strerror or error}') from error
        return root / name
    raise FileError(f'{root}: has a thousand scans of {part!r} of one second')


def save_job(folder: Path, document: Mapping[str, Any]) -> None:
    """
    Write how far a scan is, whole or not at all.

    :raises FileError: it cannot be written
    """
    files.write_text(folder / JOB, json.dumps(document, indent=2, allow_nan=False) + '\n')


def load_job(folder: Path) -> dict[str, Any]:
    """
    Read how far a scan is.

    :raises FileError: there is no such file, or it is not one of ours
    """
    path = folder / JOB
    try:
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
    Write the orchestrator's parameters of a scan, as a file that a node can be started with.

    :raises FileError: it cannot be written
    """
    document = {_NODE: {_VALUES: dict(parameters)}}
    files.write_text(folder / PARAMETERS, yaml.safe_dump(document, sort_keys=False))


def load_parameters(folder: Path) -> dict[str, Any]:
    """
    Read the orchestrator's parameters of a scan; none where there is no such file.

    :raises FileError: it cannot be read, or is not one of ours
    """
    path = folder / PARAMETERS
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
def claimed(folder: Path) -> Iterator[bool]:
    """Hold a scan while the block runs, or say False: another process does."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        free = True
    except BlockingIOError:
        free = False
    except OSError:
        # a file system without locks does not tell
        free = True
    try:
        yield free
    finally:
        os.close(handle)


def close_interrupted(root: Path) -> list[str]:
    """
    Mark the scans that were running when their orchestrator ended as failed.

    Those that another process has claimed are running.

    :returns: their ids
    :raises FileError: one cannot be marked
    """
    return [path.parent.name for path in sorted(root.glob(f'*/{JOB}')) if _close(path.parent)]


def _close(folder: Path) -> bool:
    with claimed(folder) as free:
        return free and mark_interrupted(folder)


def mark_interrupted(folder: Path) -> bool:
    """
    Mark a scan as failed unless it has ended; False where it has, or is none of ours.

    :raises FileError: it cannot be written
    """
    try:
        document = load_job(folder)
    except FileError:
        return False  # somebody else's file is not ours to judge
    if Stage(document['stage']) in ENDS:
        return False
    why = f'the orchestrator ended while the scan was {document["stage"]}'
    save_job(
        folder, {**document, 'stage': str(Stage.FAILED), 'code': 'INTERRUPTED', 'detail': why}
    )
    return True
