# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether the last acceptance test of the cell allows a scan: ignored, warned of, or required."""

from datetime import timedelta
from pathlib import Path

from ivfmc_ros.acceptance.state import check_state
from ivfmc_ros.acceptance.state import CURRENT
from ivfmc_ros.acceptance.state import NEVER
from ivfmc_ros.acceptance.state import record_path
from ivfmc_ros.cell.calibration_id import calibration_id
from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.errors import HelperError
from ivfmc_ros.nodes.framework.base import CellNode

_IGNORE, _WARN, _REFUSE = 'ignore', 'warn', 'refuse'


def declare_check_parameters(node: CellNode) -> None:
    """Declare what a missing, old or failed acceptance test means for a scan."""
    node.parameter(
        'check_policy',
        _WARN,
        'What an acceptance test (ivfmc calibrate check) that is too old, failed or of another '
        'calibration does: ignore; warn in the log; refuse the scan, also of a cell that was '
        'never tested.',
        choices=(_IGNORE, _WARN, _REFUSE),
    )
    node.parameter(
        'check_max_age',
        30.0,
        'Greatest age of the acceptance test, days.',
        low=0.01,
        high=10_000.0,
    )


def require_check(node: CellNode) -> None:
    """
    Log a warning, or refuse a scan, by the last acceptance test of the cell.

    A cell.yaml that is missing or damaged is refused later, with its own reason.

    :raises HelperError: NOT_CHECKED, with the reason
    :raises FileError: the record of the test is damaged
    """
    policy, cell_file = node.get('check_policy'), Path(node.get('cell'))
    if policy == _IGNORE or not cell_file.is_file():
        return
    draft = load_draft(cell_file)
    if draft.turntable is None:
        return
    identity = calibration_id(draft.turntable, draft.lasers)
    found = check_state(
        record_path(cell_file), identity, timedelta(days=node.get('check_max_age'))
    )
    if found.state == CURRENT:
        return
    if policy == _REFUSE:
        raise HelperError('NOT_CHECKED', found.detail)
    if found.state != NEVER:
        node.get_logger().warning(found.detail)
