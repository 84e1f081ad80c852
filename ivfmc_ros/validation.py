# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of setting values: a number lies in its range, a text is one of its choices."""

from collections.abc import Iterable
from difflib import get_close_matches
import math

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import ScanError


def require_in_range(
    name: str,
    value: float,
    low: float,
    high: float,
    unit: str = '',
    *,
    open_low: bool = False,
    open_high: bool = False,
    error: type[ScanError] = ParameterError,
) -> None:
    """
    Refuse a number outside of the range from ``low`` to ``high``. NaN is always outside.

    name : of the setting; the message begins with it
    high : math.inf for no upper limit; with ``open_high`` the value must still be finite
    unit : of value, low and high, for the message
    open_low, open_high : whether the limit itself is refused, too
    :raises ParameterError: or ``error``, the value is outside of the range
    """
    # written so that a comparison with NaN, which is always false, refuses
    above = value > low if open_low else value >= low
    below = value < high if open_high else value <= high
    if above and below:
        return
    allowed = _range_text(low, high, open_low, open_high)
    raise error(f'{name}: {value} is out of range; it must be {" ".join([allowed, unit]).strip()}')


def require_one_of(
    name: str, value: str, choices: Iterable[str], *, error: type[ScanError] = ParameterError
) -> None:
    """
    Refuse a text that is not among its choices.

    name : of the setting; the message begins with it
    :raises ParameterError: or ``error``, the value is none of ``choices``
    """
    known = tuple(choices)
    if value not in known:
        raise error(f'{name}: {value!r} is not one of {", ".join(known)}')


def suggestion(name: str, known: Iterable[str]) -> str:
    """Return '; did you mean ...?' with the known name that is most similar, '' without one."""
    near = get_close_matches(name, list(known), 1)
    return f'; did you mean {near[0]!r}?' if near else ''


def _range_text(low: float, high: float, open_low: bool, open_high: bool) -> str:
    if high == math.inf:
        return f'above {_number(low)}' if open_low else f'at least {_number(low)}'
    lower = f'above {_number(low)}, up' if open_low else _number(low)
    return f'{lower} to {"below " if open_high else ""}{_number(high)}'


def _number(value: float) -> str:
    return f'{value:g}' if isinstance(value, float) else str(value)
