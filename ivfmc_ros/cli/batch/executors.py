# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Runs jobs in processes of this machine, or on a Dask cluster; outcomes come as they end."""

from collections import Counter
from collections.abc import Callable
from collections.abc import Iterator
from collections.abc import Sequence
from concurrent.futures import as_completed
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from typing import Any
from typing import Protocol
from typing import TypeVar

from ivfmc_ros.cli.batch.job import BatchOutcome
from ivfmc_ros.errors import HelperError
from ivfmc_ros.errors import ParameterError

# A job whose process dies is started again so often; it may have been another one's memory.
_ATTEMPTS = 2
# Seconds until a scheduler that does not answer is given up.
_CONNECT_S = 20


class Named(Protocol):
    """A job, which has a name of its own."""

    @property
    def name(self) -> str:
        """Name of the job."""


JobType = TypeVar('JobType', bound=Named)
# Runs one job; a function of a module, because it is called in another process.
Work = Callable[[JobType], BatchOutcome]


def run_in_processes(
    jobs: Sequence[JobType], count: int, work: Work[JobType]
) -> Iterator[BatchOutcome]:
    """
    Yield the outcome of each job; a process that dies costs its own job only.

    count : number of processes
    """
    attempts: Counter[str] = Counter()
    waiting = list(jobs)
    while waiting:
        # after a death, one at a time: the job that kills its process is found
        workers = count if not attempts else 1
        batch = waiting if not attempts else waiting[:1]
        waiting = waiting[len(batch) :]
        # spawn: a forked copy of this process could hold locks of the numeric libraries
        with ProcessPoolExecutor(workers, mp_context=get_context('spawn')) as pool:
            futures = {pool.submit(work, job): job for job in batch}
            for future in as_completed(futures):
                job = futures[future]
                try:
                    yield future.result()
                except BrokenProcessPool:
                    attempts[job.name] += 1
                    if attempts[job.name] > _ATTEMPTS:
                        yield _died(job)
                    else:
                        waiting.append(job)


def _died(job: Named) -> BatchOutcome:
    return BatchOutcome(
        name=job.name,
        code='NODE_DIED',
        detail='the process died in each attempt, maybe for lack of memory',
    )


def run_on_cluster(
    jobs: Sequence[JobType], address: str, work: Work[JobType]
) -> Iterator[BatchOutcome]:
    """
    Yield the outcome of each job on a Dask cluster whose workers see the same folders.

    address : of the scheduler, such as tcp://host:8786
    :raises ParameterError: Dask is not installed
    :raises HelperError: the scheduler does not answer
    """
    try:
        from distributed import as_completed as completed
        from distributed import Client
    except ModuleNotFoundError:
        raise ParameterError(
            '--dask: Dask is not installed; install the extra ivfmc_ros[dask]'
        ) from None
    try:
        client: Any = Client(address, timeout=_CONNECT_S)  # type: ignore[no-untyped-call]
    except (OSError, ValueError, TimeoutError) as error:
        raise HelperError('TIMEOUT', f'{address}: no Dask scheduler answers: {error}') from error
    with client:
        futures = {client.submit(work, job, pure=False): job for job in jobs}
        for future in completed(list(futures)):  # type: ignore[no-untyped-call]
            yield _outcome(future, futures[future])


def _outcome(future: Any, job: Named) -> BatchOutcome:
    error = future.exception()
    if error is None:
        outcome: BatchOutcome = future.result()
        return outcome
    # KilledWorker: several workers died of the job
    detail = f'{type(error).__name__}: {error}'
    return BatchOutcome(name=job.name, code='NODE_DIED', detail=detail)
