# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Code of a scan by the registrar's checks: lost steps, views and lasers that disagree."""

from collections.abc import Mapping
from typing import Any
from typing import Protocol

# Codes that a scan ends with; UNCHECKED is a doubt that is said beside OK.
_FAILURES = ('SLIPPED', 'NOT_CONVERGED', 'TRIGGER_REFUSED')
_UNCHECKED = 'UNCHECKED'


class Markable(Protocol):
    """An outcome of a scan that a code and a text can be added to."""

    registration: Mapping[str, Any]

    def mark(self, code: str, detail: str) -> None:
        """Set the code unless one is set, and add the text."""


def judge_table(outcome: Markable) -> None:
    """
    Mark a scan whose views disagree with its code, and one that could not be checked.

    What the lasers advise (calibrate again, take more profiles), and which triggered pictures are
    missing or were left out, is said beside OK, as is a light sheet that moved in the scan.
    """
    table = outcome.registration.get('table') or {}
    code, detail = table.get('code', ''), table.get('detail', '')
    if code in _FAILURES:
        outcome.mark(code, detail)
    elif code == _UNCHECKED:
        outcome.mark('OK', f'{_UNCHECKED}: {detail}')
    if table.get('drift') and table['drift'] != detail:
        outcome.mark('OK', f'drift: {table["drift"]}')
    if table.get('triggers'):
        outcome.mark('OK', f'triggers: {table["triggers"]}')
    lasers = outcome.registration.get('lasers') or {}
    if lasers.get('advice'):
        outcome.mark('OK', lasers['advice'])
