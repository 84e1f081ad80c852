# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The one long job of registrar or mesher: it belongs to a scan, and ends with it."""

from collections.abc import Iterator
import contextlib
from contextlib import contextmanager
from typing import Any

from ivfmc_ros.errors import BusyError
from ivfmc_ros.errors import CancelledError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.processing import worker_jobs
from ivfmc_ros.worker import Job
from ivfmc_ros.worker import Worker


class Claim:
    """The right to work for one request; ``cancelled`` says why it was withdrawn, or ''."""

    def __init__(self) -> None:
        self.cancelled = ''

    def require(self) -> None:
        """:raises CancelledError: the work was cancelled."""
        if self.cancelled:
            raise CancelledError(self.cancelled)


class ExclusiveJob:
    """Runs one request at a time, its long calls in a child process that can be killed."""

    def __init__(self, node: CellNode) -> None:
        self._node = node
        self._worker = Worker([worker_jobs.__name__])
        self._claim: Claim | None = None
        self._background: Claim | None = None

    @property
    def busy(self) -> bool:
        """Whether a request is being worked on."""
        return self._claim is not None

    @contextmanager
    def claim(self, what: str) -> Iterator[Claim]:
        """
        Reserve the worker for the time of the block.

        what : that runs, for the error of a second request
        :raises BusyError: another request is being worked on
        """
        if self._claim is not None:
            raise BusyError(f'{self._node.get_name()}: {what} is running already')
        claim = self._claim = Claim()
        try:
            yield claim
        finally:
            if self._claim is claim:
                self._claim = None

    async def run(self, claim: Claim, job: Job, *arguments: Any) -> Any:
        """
        Run a job in the child process and return its result.

        :raises CancelledError: the claim was withdrawn, also in the moment in which the job ended
        :raises ScanError: the job failed
        """
        claim.require()

        def work() -> Any:
            return self._worker.run(job, *arguments, cancelled=lambda: bool(claim.cancelled))

        try:
            result = await self._node.in_thread(work)
        except CancelledError:
            claim.require()
            raise
        claim.require()
        return result

    def begin(self, job: Job, *arguments: Any) -> bool:
        """
        Run a job in the background whose result stays in the child process.

        A request that comes meanwhile runs after it. An error of the job is not reported: the
        request that needs its result gets the same one.

        :returns: False where a request or another such job is running
        """
        if self._claim is not None or self._background is not None:
            return False
        claim = self._background = Claim()

        def work() -> None:
            try:
                with contextlib.suppress(ScanError):
                    self._worker.run(job, *arguments, cancelled=lambda: bool(claim.cancelled))
            finally:
                if self._background is claim:
                    self._background = None

        self._node.in_thread(work)
        return True

    def cancel(self, reason: str) -> bool:
        """
        End the work on the present request, whose caller gets CANCELLED, and in the background.

        The next request can begin at once.

        :returns: whether there was a request
        """
        claim, self._claim = self._claim, None
        background, self._background = self._background, None
        for withdrawn in (claim, background):
            if withdrawn is not None:
                withdrawn.cancelled = reason
        if claim is not None or background is not None:
            self._worker.kill()
        return claim is not None

    def close(self) -> None:
        """Kill the child process."""
        self._worker.close()
