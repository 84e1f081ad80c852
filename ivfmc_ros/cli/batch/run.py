# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reconstruction of many bags: one folder each, results in the catalogue, a summary at the end."""

from collections.abc import Iterator
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict
import json
from pathlib import Path

import click
from rich.table import Table

from ivfmc_ros import files
from ivfmc_ros.cli.batch.executors import run_in_processes
from ivfmc_ros.cli.batch.executors import run_on_cluster
from ivfmc_ros.cli.batch.job import BatchJob
from ivfmc_ros.cli.batch.job import BatchOutcome
from ivfmc_ros.cli.batch.job import run_job
from ivfmc_ros.cli.support.output import console
from ivfmc_ros.cli.support.output import print_json
from ivfmc_ros.cli.support.source import bag_of
from ivfmc_ros.cli.support.source import BagOptions
from ivfmc_ros.errors import CatalogueError
from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.pipeline import Settings
from ivfmc_ros.storage.bag.decompression import plain_name
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.catalogue.catalogue import FILE_NAME
from ivfmc_ros.storage.catalogue.database import url_of_environment

SUMMARY = 'batch_summary.json'


def make_jobs(
    sources: Sequence[str],
    output: Path,
    settings: Settings,
    reading: BagOptions,
    *,
    root: Path,
    cell_path: Path | None,
    camera_path: Path | None,
) -> list[BatchJob]:
    """
    Return a job for each source; paths are absolute, because workers run elsewhere.

    :raises FileError: a source can only be a bag, and there is none
    :raises ParameterError: two sources would have one result folder
    """
    jobs = []
    for source in sources:
        bag = bag_of(source)
        # CELL/SCAN_ID: cells may have scans of one id
        name = source.replace('/', '_') if bag is None else _name(bag)
        jobs.append(
            BatchJob(
                name=name,
                output=output.absolute(),
                settings=settings,
                bag=None if bag is None else bag.absolute(),
                scan_id=source if bag is None else '',
                root=root.absolute(),
                cell_path=None if cell_path is None else cell_path.absolute(),
                camera_path=None if camera_path is None else camera_path.absolute(),
                reading=reading,
            )
        )
    names = [job.name for job in jobs]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ParameterError(f'{twice[0]}: several sources have this name; reconstruct them apart')
    return jobs


def run_batch(
    jobs: Sequence[BatchJob], *, processes: int, dask: str, as_json: bool
) -> list[BatchOutcome]:
    """
    Run all jobs; results that are there already are kept.

    processes : number of processes, where ``dask`` is ''
    dask : address of a Dask scheduler
    :raises HelperError: a job failed, after all have ended
    """
    files.make_folder(jobs[0].output)
    by_name = {job.name: job for job in jobs}
    outcomes: list[BatchOutcome] = []
    for outcome in _outcomes(jobs, processes, dask):
        outcomes.append(outcome)
        _add_to_catalogue(by_name[outcome.name], outcome)
        state = outcome.code if outcome.is_new or outcome.code != 'OK' else 'OK, was there'
        click.echo(
            f'[{len(outcomes)}/{len(jobs)}] {outcome.name}: {state} ({outcome.seconds:.1f} s)',
            err=True,
        )
        _save(jobs[0].output, outcomes)
    if as_json:
        print_json([asdict(outcome) for outcome in outcomes])
    else:
        console().print(_table(outcomes))
    failed = [outcome for outcome in outcomes if outcome.code != 'OK']
    if failed:
        first = failed[0]
        raise HelperError(
            first.code,
            f'{len(failed)} of {len(jobs)} failed, the first: {first.name}: {first.code}: '
            f'{first.detail}',
        )
    return outcomes


def _outcomes(jobs: Sequence[BatchJob], processes: int, dask: str) -> Iterator[BatchOutcome]:
    if dask:
        yield from run_on_cluster(jobs, dask, run_job)
    elif processes > 1:
        yield from run_in_processes(jobs, processes, run_job)
    else:
        yield from map(run_job, jobs)


def _add_to_catalogue(job: BatchJob, outcome: BatchOutcome) -> None:
    """Add the result of a scan of the catalogue, once."""
    if not job.folder.is_dir():
        return
    if job.scan_id:
        _add_result(Catalogue(job.root), job.scan_id, job, outcome)
    elif job.bag is not None and _is_of_catalogue(job.bag, job.root):
        # a folder beside a catalogue need not be one of its scans
        with suppress(CatalogueError):
            _add_result(Catalogue(job.bag.parent), job.bag.name, job, outcome)


def _is_of_catalogue(bag: Path, root: Path) -> bool:
    """Return whether a bag can be a scan of the catalogue: by its place, not by its name alone."""
    if not bag.is_dir():
        return False
    return bag.parent == root if url_of_environment() else (bag.parent / FILE_NAME).is_file()


def _add_result(catalogue: Catalogue, scan_id: str, job: BatchJob, outcome: BatchOutcome) -> None:
    try:
        if all(result.folder != job.folder for result in catalogue.results(scan_id)):
            catalogue.add_result(scan_id, str(job.folder), {'counts': dict(outcome.counts)})
    finally:
        catalogue.close()


def _save(output: Path, outcomes: Sequence[BatchOutcome]) -> None:
    rows = [asdict(outcome) for outcome in sorted(outcomes, key=lambda outcome: outcome.name)]
    files.write_text(output / SUMMARY, json.dumps(rows, indent=2, default=str) + '\n')


def _table(outcomes: Sequence[BatchOutcome]) -> Table:
    table = Table('scan', 'code', 'pictures', 'triangles', 's', 'detail')
    for outcome in sorted(outcomes, key=lambda outcome: outcome.name):
        counts = [str(outcome.counts.get(key, '')) for key in ('pictures', 'faces')]
        table.add_row(
            outcome.name, outcome.code, *counts, f'{outcome.seconds:.1f}', outcome.detail
        )
    return table


def _name(bag: Path) -> str:
    resolved = bag.resolve()
    if resolved.is_dir():
        return resolved.name
    return Path(plain_name(resolved)).stem.removesuffix('.mcap')
