# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Results of a long bench, kept on disk so that a run that was ended can be continued."""

from collections.abc import Callable
from functools import cache
import hashlib
from pathlib import Path
import pickle
from typing import TypeVar

Result = TypeVar('Result')

_ROOT = Path(__file__).resolve().parents[2]
KEPT = _ROOT / 'build' / 'bench' / 'faults' / 'kept'
# A result belongs to these sources, and is measured again when one has changed.
_SOURCES = ('ivfmc_ros', 'test/support', 'config')


@cache
def digest() -> str:
    """Return a name for the state of all sources."""
    found = hashlib.sha256()
    for folder in _SOURCES:
        for path in sorted((_ROOT / folder).rglob('*')):
            if path.suffix in ('.py', '.yaml', '.xml'):
                found.update(path.read_bytes())
    return found.hexdigest()[:24]


def kept(
    key: str,
    work: Callable[[], Result],
    is_final: Callable[[Result], bool] = lambda _: True,
    folder: Path = KEPT,
) -> Result:
    """
    Return what ``work`` returned for a key with the present sources, or do it now.

    is_final : whether a result is kept
    """
    name = hashlib.sha256(key.encode()).hexdigest()[:24]
    path = folder / digest() / f'{name}.pickle'
    if path.exists():
        return pickle.loads(path.read_bytes())
    result = work()
    if not is_final(result):
        return result
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(f'.{id(result)}')
    part.write_bytes(pickle.dumps(result))
    part.rename(path)
    return result
