# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Awaits the verdict on the mesh of a scan by its recipe."""

from collections.abc import Awaitable
from collections.abc import Callable
from collections.abc import Mapping
from typing import Any

from ivfmc_ros.nodes.framework.futures import Condition
from ivfmc_ros.nodes.scanning.scan_context import ScanContext
from ivfmc_ros.scan.job import Outcome
from ivfmc_ros.scan.recipe_verdict import InspectionProcess
from ivfmc_ros.scan.recipe_verdict import undecided

# Seconds that an inspection may take.
_INSPECTION_S = 1800.0
# Awaits a condition: seconds, what is waited for, code of the error.
Until = Callable[[Condition, float, str, str], Awaitable[None]]


async def judge_mesh(context: ScanContext, outcome: Outcome, until: Until) -> Mapping[str, Any]:
    """Return the verdict in short; of a scan that is not OK nothing is decided."""
    name = context.request.recipe
    if outcome.code != 'OK':
        return undecided(name, f'the scan is {outcome.code}: {outcome.detail}')
    process = InspectionProcess(context.folder, name)
    try:
        what = 'the inspection of the mesh'
        await until(lambda: process.is_done, _INSPECTION_S, what, 'TIMEOUT')
        return process.result()
    finally:
        # a scan that is cancelled ends at once
        process.kill()
