# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Requests and background jobs of one worker process."""

import asyncio
import time

import pytest

from ivfmc_ros.errors import CancelledError
from ivfmc_ros.nodes.processing import exclusive_job
from ivfmc_ros.nodes.processing.exclusive_job import ExclusiveJob
from ivfmc_ros.worker import Worker


class Node:
    """What an ExclusiveJob needs of a node."""

    def get_name(self):
        return 'mesher'

    def in_thread(self, function, *arguments):
        return asyncio.get_running_loop().run_in_executor(None, function, *arguments)


@pytest.fixture
def job(monkeypatch):
    # without the libraries of the real jobs
    monkeypatch.setattr(exclusive_job, 'Worker', lambda _: Worker())
    job = ExclusiveJob(Node())
    yield job
    job.close()


async def request(job, function, *arguments):
    with job.claim('a build') as claim:
        return await job.run(claim, function, *arguments)


def test_request_runs_after_a_background_job(job):
    async def work():
        begin = time.monotonic()
        assert job.begin(time.sleep, 0.5)
        # one at a time
        assert not job.begin(time.sleep, 60.0)
        assert await request(job, abs, -3) == 3
        return time.monotonic() - begin

    assert asyncio.run(work()) >= 0.5


def test_error_of_a_background_job_is_left_to_the_request(job):
    async def work():
        assert job.begin(divmod, 1, 0)
        return await request(job, abs, -3)

    assert asyncio.run(work()) == 3


def test_cancel_ends_the_request_and_the_background_job(job):
    async def work():
        assert job.begin(time.sleep, 60.0)
        waiting = asyncio.ensure_future(request(job, abs, -3))
        await asyncio.sleep(0.1)
        assert job.cancel('a new scan')
        with pytest.raises(CancelledError, match='a new scan'):
            await waiting
        return await request(job, abs, -4)

    assert asyncio.run(work()) == 4


def test_background_job_alone_is_cancelled_too(job):
    async def work():
        begin = time.monotonic()
        assert job.begin(time.sleep, 60.0)
        # there is no request whose caller would be told
        assert not job.cancel('a new scan')
        assert await request(job, abs, -5) == 5
        return time.monotonic() - begin

    assert asyncio.run(work()) < 50.0


def test_no_background_job_begins_beside_a_request(job):
    async def work():
        waiting = asyncio.ensure_future(request(job, time.sleep, 0.3))
        await asyncio.sleep(0.05)
        assert not job.begin(abs, 1)
        await waiting

    asyncio.run(work())
