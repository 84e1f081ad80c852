# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One measured figure and the bar that it has to meet."""

from dataclasses import dataclass
import math


@dataclass(frozen=True)
class Bar:
    """A limit in the unit of the figure; ``sign`` is '<=' or '>='."""

    sign: str
    limit: float

    def is_met_by(self, value: float) -> bool:
        """Whether ``value`` is on the right side; NaN and infinities never are."""
        if not math.isfinite(value):
            return False
        # values come from numpy too, whose truth is no bool to JSON
        return bool(value <= self.limit if self.sign == '<=' else value >= self.limit)

    def __str__(self) -> str:
        return f'{self.sign} {self.limit:.10g}'


def at_most(limit: float) -> Bar:
    """Bar of a figure that is good when it is small."""
    return _bar('<=', limit)


def at_least(limit: float) -> Bar:
    """Bar of a figure that is good when it is large."""
    return _bar('>=', limit)


def _bar(sign: str, limit: float) -> Bar:
    if not math.isfinite(limit):
        raise ValueError(f'a bar needs a finite limit, not {limit}')
    return Bar(sign, float(limit))


@dataclass(frozen=True)
class Number:
    """
    A figure called ``name`` in ``unit``.

    Without a bar it informs and passes no judgement (``ok`` is None).
    """

    name: str
    value: float
    unit: str
    bar: Bar | None = None
    note: str = ''

    @property
    def ok(self) -> bool | None:
        """Whether the bar is met: computed, so that no bench can claim it."""
        return None if self.bar is None else self.bar.is_met_by(self.value)

    def as_dict(self) -> dict[str, str | float | bool | None]:
        """Return the entry of the result file; JSON has no NaN, so that it becomes null."""
        return {
            'name': self.name,
            'value': float(self.value) if math.isfinite(self.value) else None,
            'unit': self.unit,
            'bar': None if self.bar is None else str(self.bar),
            'ok': self.ok,
            'note': self.note,
        }
