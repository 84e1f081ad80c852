# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of report figures in SI units to HTML tables in millimeters and degrees."""

from collections.abc import Callable
from collections.abc import Collection
from collections.abc import Mapping
from collections.abc import Sequence
from html import escape
import json
import math
from pathlib import Path
import re
from typing import Any

from ivfmc_ros.inspection.verdict import PASS

# Rows of a table on a printed page, which has four sheets at most.
PRINTED_ROWS = 24
# Keys whose texts stay in one line, and those whose texts are sentences.
_LINES, _SENTENCES = ('feature', 'name', 'position_m'), ('budget_of_u', 'why', 'reason')
# What is shown of figures in SI units: unit, factor, decimals.
_MILLIMETERS = ('mm', 1e3, 4)
_DEGREES = ('deg', math.degrees(1.0), 3)
_RATE = ('deg/s', math.degrees(1.0), 2)
_SECONDS = ('s', 1.0, 1)
# A suffix tells the unit of a figure; these have none.
_UNITS = {
    'angle_from': _DEGREES,
    'angle_to': _DEGREES,
    'jitter': ('ms', 1e3, 2),
    'max_edge': _MILLIMETERS,
    'noise': _MILLIMETERS,
    'position_m': ('mm', 1e3, 3),
    'rms': _MILLIMETERS,
    'rms_after': _MILLIMETERS,
    'rms_before': _MILLIMETERS,
    'rotation': _DEGREES,
    'speed': _RATE,
    'translation': _MILLIMETERS,
    'coverage': ('%', 100.0, 1),
    'within': ('%', 100.0, 2),
}
# The folders of an absolute path; the first one tells it from a topic.
_PATH = re.compile(r'(?<![\w./])/([^\s/:]+)/(?:[^\s/:]+/)*')


def tables(figures: Mapping[str, Any]) -> str:
    """
    Return figures as sections: what has parts of its own comes below what has none.

    figures : mappings become sections of pairs, lists of mappings tables; what is empty is
        left out. Meters are shown in millimeters, radians in degrees.
    """
    return _section(figures, 2)


def folded(figures: Mapping[str, Any], unfolded: Collection[str]) -> str:
    """
    Return figures as sections that a reader can fold and unfold.

    figures : as of ``tables``
    unfolded : names of the parts that are shown at once
    """

    def fold(key: str, inner: str) -> str:
        state = ' open' if key in unfolded else ''
        return f'<details{state}><summary><h2>{escape(_name(key))}</h2></summary>{inner}</details>'

    return _section(figures, 2, fold)


def without_folders(text: str) -> str:
    """Return a text in which absolute paths of this computer are names: it is read elsewhere."""
    return _PATH.sub(lambda found: '' if Path(f'/{found[1]}').is_dir() else found[0], text)


def verdict(text: str) -> str:
    """Return a verdict in its color."""
    safe = escape(text)
    return f'<span class="{safe.split(maxsplit=1)[0]}">{safe}</span>'


def _section(
    figures: Mapping[str, Any], level: int, wrap: Callable[[str, str], str] | None = None
) -> str:
    """Return pairs, then each part with a heading of ``level`` or as ``wrap`` makes it of both."""
    parts = {key: value for key, value in figures.items() if not _empty(value)}
    plain = {key: value for key, value in parts.items() if not _nested(value)}
    html = [_pairs(plain)] if plain else []
    for key, value in parts.items():
        if not _nested(value):
            continue
        inner = _section(value, level + 1) if isinstance(value, Mapping) else _table(value)
        heading = f'<h{level}>{escape(_name(key))}</h{level}>{inner}'
        html.append(wrap(key, inner) if wrap else heading)
    return ''.join(html)


def _empty(value: Any) -> bool:
    return value is None or (isinstance(value, str | list | tuple | Mapping) and not value)


def _nested(value: Any) -> bool:
    if isinstance(value, list | tuple):
        return all(isinstance(item, Mapping) for item in value)
    return isinstance(value, Mapping)


def _pairs(values: Mapping[str, Any]) -> str:
    rows = ''.join(
        f'<tr><td>{escape(_label(key))}</td><td>{_cell(key, item)}</td></tr>'
        for key, item in values.items()
    )
    return f'<div class="wide"><table>{rows}</table></div>'


def _table(rows: Sequence[Mapping[str, Any]]) -> str:
    # columns in which no row says anything are left out
    keys = [key for key in rows[0] if not all(_empty(row.get(key)) for row in rows)]
    head = ''.join(f'<th>{escape(_label(key))}</th>' for key in keys)
    printed = _printed(rows)
    body = ''.join(
        ('<tr>' if number in printed else '<tr class="unprinted">')
        + ''.join(f'<td>{_cell(key, row.get(key))}</td>' for key in keys)
        + '</tr>'
        for number, row in enumerate(rows)
    )
    if len(printed) < len(rows):
        body += (
            f'<tr class="print"><td colspan="{len(keys)}">{len(rows) - len(printed)} more rows '
            'are in the file that this was printed from</td></tr>'
        )
    return f'<div class="wide"><table><tr>{head}</tr>{body}</table></div>'


def _printed(rows: Sequence[Mapping[str, Any]]) -> set[int]:
    """Return the rows that a printed page has room for: those that did not pass first."""
    ranks = [row.get('verdict') == PASS for row in rows]
    order = sorted(range(len(rows)), key=lambda number: (ranks[number], number))
    return set(order[:PRINTED_ROWS])


def _unit(key: str) -> tuple[str, float, int] | None:
    if key not in _UNITS and key.endswith('_m'):
        return _MILLIMETERS
    return _SECONDS if key.endswith('_s') else _UNITS.get(key)


def _name(key: str) -> str:
    return (key[:-2] if key.endswith(('_m', '_s')) else key).replace('_', ' ')


def _label(key: str) -> str:
    unit = _unit(key)
    return _name(key) if unit is None else f'{_name(key)}, {unit[0]}'


def _cell(key: str, value: Any) -> str:
    if _empty(value):
        return ''
    if isinstance(value, Mapping):
        return _pairs(value)
    if isinstance(value, list | tuple):
        # the rows of a matrix are lines
        between = '<br>' if isinstance(value[0], list | tuple) else ', '
        joined = between.join(
            escape(_number(key, item)) if _is_plain(item) else _cell(key, item) for item in value
        )
        return _styled(key, joined)
    return verdict(str(value)) if key == 'verdict' else _styled(key, escape(_number(key, value)))


def _is_plain(value: Any) -> bool:
    return not isinstance(value, list | tuple | Mapping)


def _styled(key: str, html: str) -> str:
    kind = 'line' if key in _LINES else 'sentence' if key in _SENTENCES else ''
    return f'<span class="{kind}">{html}</span>' if kind else html


def _number(key: str, value: Any) -> str:
    if isinstance(value, bool):
        return 'yes' if value else 'no'
    if isinstance(value, int | float):
        unit = _unit(key)
        if not math.isfinite(value):
            return ''
        if unit is not None:
            # the last part turns -0.0 into 0.0
            return f'{round(value * unit[1], unit[2]) + 0.0:.{unit[2]}f}'
        return f'{value:,}' if isinstance(value, int) else f'{value:.4g}'
    return without_folders(value) if isinstance(value, str) else json.dumps(value)
