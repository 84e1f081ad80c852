# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Reconstruction of one bag of many, in a process of its own; also the function that Dask calls.

A result folder appears when it is complete, with ``batch.json``: the fingerprint of bag, cell and
settings. A job whose folder is there with the same fingerprint is done.
"""

from collections.abc import Mapping
from dataclasses import asdict
from dataclasses import dataclass
from dataclasses import field
import hashlib
import json
from pathlib import Path
import tempfile
import time
from typing import Any

from ivfmc_ros import files
from ivfmc_ros.cli.support.source import BagOptions
from ivfmc_ros.cli.support.source import read_scan
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.pipeline import reconstruct
from ivfmc_ros.pipeline import reconstruct_profiles
from ivfmc_ros.pipeline import Settings
from ivfmc_ros.results import write_results
from ivfmc_ros.scan.title_block import source_texts
from ivfmc_ros.storage.bag.locate import find_files
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.scans.stored_scan import load_profiles
from ivfmc_ros.stripe.opencv_threads import use_one_thread

MARK = 'batch.json'


@dataclass(frozen=True, kw_only=True)
class BatchJob:
    """
    One bag to reconstruct.

    name : of the result folder below ``output``
    bag : bag; None for a scan of the catalogue
    scan_id : of the catalogue in ``root``, '' for a bag
    """

    name: str
    output: Path
    settings: Settings
    bag: Path | None = None
    scan_id: str = ''
    root: Path = Path()
    cell_path: Path | None = None
    camera_path: Path | None = None
    reading: BagOptions = field(default_factory=BagOptions)

    @property
    def folder(self) -> Path:
        """Folder of the result."""
        return self.output / self.name


@dataclass(frozen=True, kw_only=True)
class BatchOutcome:
    """
    How a job ended.

    code : OK, or that of an error; the views of a result with another code do not agree
    is_new : the result was computed now, and was not there before
    """

    name: str
    code: str
    detail: str = ''
    seconds: float = 0.0
    counts: Mapping[str, Any] = field(default_factory=dict)
    is_new: bool = False


def run_job(job: BatchJob) -> BatchOutcome:
    """Reconstruct one bag; an error becomes the outcome of this job alone."""
    begin = time.monotonic()
    use_one_thread()
    try:
        outcome = _finished(job) or _reconstruct(job)
    except ScanError as error:
        outcome = BatchOutcome(name=job.name, code=error.code, detail=str(error))
    except Exception as error:  # a fault of one bag must not end the others
        outcome = BatchOutcome(
            name=job.name, code='INTERNAL', detail=f'{type(error).__name__}: {error}'
        )
    seconds = time.monotonic() - begin
    return BatchOutcome(**{**vars(outcome), 'seconds': seconds})


def _finished(job: BatchJob) -> BatchOutcome | None:
    """Return the outcome of a job whose result is there; None where it is not."""
    if not job.folder.exists():
        return None
    try:
        mark = json.loads(files.read_bytes(job.folder / MARK))
        known, code, counts = str(mark['fingerprint']), str(mark['code']), dict(mark['counts'])
    except (FileError, ValueError, KeyError, TypeError) as error:
        raise FileError(f'{job.folder}: exists already and is no result of a batch') from error
    if known != fingerprint(job):
        raise FileError(
            f'{job.folder}: was made of another bag, cell or settings; name another folder'
        )
    return BatchOutcome(name=job.name, code=code, counts=counts)


def _reconstruct(job: BatchJob) -> BatchOutcome:
    mark = fingerprint(job)
    if job.bag is not None:
        scan, cell = read_scan(job.bag, job.cell_path, job.camera_path, job.reading)
        made = reconstruct(cell, scan.frames(), job.settings, scan.frame_count)
        skipped: Mapping[str, int] = scan.skipped
    else:
        profiles, cell = load_profiles(job.root, job.scan_id, job.cell_path, job.camera_path)
        made, skipped = reconstruct_profiles(cell, profiles, job.settings), {}
    files.make_folder(job.output)
    with tempfile.TemporaryDirectory(prefix=f'.{job.name}-', dir=job.output) as name:
        result = Path(name) / 'result'
        source = str(job.bag or job.scan_id)
        heading = source_texts(_folder_of(job), job.cell_path)
        document = write_results(result, cell, made, source, skipped, heading=heading)
        code = str(document.get('code', 'OK'))
        counts = {**document['counts'], 'residuals': document['residuals']}
        text = json.dumps({'fingerprint': mark, 'code': code, 'counts': counts}, default=str)
        files.write_text(result / MARK, text + '\n')
        try:
            result.rename(job.folder)
        except OSError as error:
            # another worker was given the job too, and was faster
            finished = _finished(job) if job.folder.exists() else None
            if finished is None:
                reason = error.strerror or error
                raise FileError(f'{job.folder}: cannot be written: {reason}') from error
            return finished
    detail = str(document.get('detail', ''))
    return BatchOutcome(name=job.name, code=code, detail=detail, counts=counts, is_new=True)


def _folder_of(job: BatchJob) -> Path:
    """Return the folder of the bag, or that of the scan."""
    if job.bag is None:
        return Catalogue(job.root).scan(job.scan_id).folder
    return job.bag if job.bag.is_dir() else job.bag.parent


def fingerprint(job: BatchJob) -> str:
    """
    Return what the result follows from: bag (name, size, time), calibration, settings.

    :raises ScanError: the bag does not exist
    """
    paths: tuple[Path, ...] = ()
    folder = job.bag
    if job.bag is None:
        folder = Catalogue(job.root).scan(job.scan_id).folder
    if folder is not None:
        paths, _ = find_files(folder)
        folder = folder if folder.is_dir() else folder.parent
    found: dict[str, Any] = {'settings': asdict(job.settings), 'reading': asdict(job.reading)}
    for path in paths:
        try:
            status = path.stat()
        except OSError as error:
            raise FileError(f'{path}: cannot be read: {error.strerror or error}') from error
        found[path.name] = [status.st_size, status.st_mtime_ns]
    for key, chosen, name in (
        ('cell', job.cell_path, 'cell.yaml'),
        ('camera', job.camera_path, 'camera.yaml'),
    ):
        path = chosen or (folder or Path()) / name
        data = files.read_bytes(path) if path.is_file() else b''
        found[key] = hashlib.sha256(data).hexdigest()
    text = json.dumps(found, sort_keys=True, default=repr)
    return hashlib.sha256(text.encode()).hexdigest()
