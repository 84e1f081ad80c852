# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A scan's status (``scan_status``) in words and HTML."""

from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
import json
from typing import Any

from ivfmc_ros.codes import CODES

# Attributes of an element whose changes a screen reader says.
STATUS = 'role="status" aria-live="polite"'
_STAGES = {
    '': 'waiting for the cell',
    'IDLE': 'idle',
    'PREPARING': 'preparing',
    'SCANNING': 'scanning',
    'PAUSED': 'paused, laser off',
    'REGISTERING': 'registering the views',
    'MESHING': 'building the mesh',
    'INSPECTING': 'comparing with the nominal',
    'FINISHING': 'writing the files',
    'DONE': 'done',
    'FAILED': 'failed',
    'CANCELLED': 'cancelled',
}
ENDED = ('DONE', 'FAILED', 'CANCELLED')
_QUIET = ('', 'IDLE', *ENDED)
# Background and text by verdict: each pair has a contrast of 7 or more (WCAG 2.1, AAA).
_COLORS = {
    'pass': ('#0b5d1e', '#ffffff'),
    'fail': ('#8f1010', '#ffffff'),
    'not decided': ('#ffd966', '#1a1a1a'),
    'OK': ('#1d3f72', '#ffffff'),
}
# Width of the verdict: characters on a line times their size, rem.
_VERDICT_WIDTH = 26.0


@dataclass(frozen=True, kw_only=True)
class ScanState:
    """
    What the page shows of a scan.

    running : a scan is in progress, and can be cancelled
    pausable, paused : it can be paused; it is
    percent : profiles on disk, 0 to 100
    headline : the stage in words
    verdict : pass, fail or not decided; '' without one
    remedy : what to do after a code other than OK, '' else
    """

    scan_id: str
    stage: str
    code: str
    running: bool
    pausable: bool
    paused: bool
    percent: float
    headline: str
    verdict: str
    detail: str
    remedy: str
    report: str
    result: Mapping[str, Any]


def scan_state(values: Mapping[str, str]) -> ScanState:
    """Read the values of scan_status; missing and malformed ones count as empty."""
    stage = values.get('stage', '')
    result = _parsed(values.get('result', ''))
    code = values.get('code', '')
    done, total = _number(values, 'profiles_done'), _number(values, 'profiles_total')
    known = CODES.get(code)
    headline = _STAGES.get(stage, stage.lower())
    if stage == 'SCANNING':
        eta = _number(values, 'eta_s')
        headline += f': {done:.0f} of {total:.0f} profiles, about {eta:.0f} s left'
    return ScanState(
        scan_id=values.get('scan_id', ''),
        stage=stage,
        code=code,
        running=stage not in _QUIET,
        pausable=stage in ('PREPARING', 'SCANNING'),
        paused=stage == 'PAUSED',
        percent=min(100.0, 100.0 * done / total) if total > 0 else 0.0,
        headline=headline,
        verdict=values.get('verdict', ''),
        detail=str(result.get('detail', '')),
        remedy=known.action if known and code != 'OK' else '',
        report=values.get('report', ''),
        result=result,
    )


def verdict_html(state: ScanState) -> str:
    """Return the verdict, or the code of the scan, to be read from three meters."""
    ended = state.code if state.stage in ENDED else ''
    # as in the report: a scan that is not OK passes nothing
    text = ended if ended not in ('', 'OK') else state.verdict or ended
    if not text:
        return ''
    # further verdicts decide nothing either
    kind = text if text in _COLORS else 'not decided' if text == state.verdict else 'fail'
    background, color = _COLORS[kind]
    # a long code on one line
    size = min(4.0, _VERDICT_WIDTH / len(text))
    return (
        f'<div role="status" aria-live="assertive" style="background:{background};color:{color};'
        f'font-size:min(9vw,{size:.2g}rem);font-weight:700;text-align:center;padding:0.2em;'
        f'border-radius:0.15em">{escape(text.upper())}</div>'
    )


def message_html(state: ScanState) -> str:
    """Return what went wrong, and the remedy; '' where nothing did."""
    if not state.detail and not state.remedy:
        return ''
    lines = [f'<p><b>{escape(state.code)}</b>: {escape(state.detail)}</p>']
    if state.remedy:
        lines.append(f'<p><b>Remedy:</b> {escape(_plain(state.remedy))}</p>')
    return f'<div role="alert">{"".join(lines)}</div>'


def health_html(nodes: Sequence[tuple[str, str, str]]) -> str:
    """
    Return a table of the nodes.

    nodes : name, level (ok, warning, error, lost) and message of each
    """
    marks = {'ok': '✓', 'warning': '!', 'error': '✗', 'lost': '✗'}
    rows = ''.join(
        f'<tr><td>{marks.get(level, "?")} {escape(name)}</td><td>{escape(level)}</td>'
        f'<td>{escape(message)}</td></tr>'
        for name, level, message in nodes
    )
    head = '<tr><th scope="col">node</th><th scope="col">state</th><th scope="col">says</th></tr>'
    return (
        '<table aria-label="Health of the nodes" style="font-size:0.8rem;text-align:left;'
        'border-spacing:0.6em 0.1em">'
        f'{head}{rows}</table>'
    )


def features_html(result: Mapping[str, Any]) -> str:
    """Return the table of the measured features of a result; '' without an inspection."""
    inspection = result.get('inspection')
    if not isinstance(inspection, Mapping):
        return ''
    rows = ''
    for row in inspection.get('characteristics', ()):
        measured, nominal = row.get('measured_m'), row.get('nominal_m')
        known = isinstance(measured, int | float) and isinstance(nominal, int | float)
        cells = (
            f'{row.get("feature", "")} {row.get("characteristic", "")}',
            _millimeters(measured - nominal if known else None, '+'),
            _millimeters(row.get('U_m')),
            str(row.get('verdict', '')),
        )
        rows += '<tr>' + ''.join(f'<td>{escape(cell)}</td>' for cell in cells) + '</tr>'
    if not rows:
        return ''
    names = ('characteristic', 'deviation, mm', 'U, mm', 'verdict')
    head = ''.join(f'<th scope="col">{name}</th>' for name in names)
    return (
        '<table aria-label="Features" style="font-size:0.8rem;text-align:left;'
        f'border-spacing:0.6em 0.1em"><tr>{head}</tr>{rows}</table>'
    )


def _millimeters(value: Any, sign: str = '') -> str:
    return f'{1e3 * value:{sign}.3f}' if isinstance(value, int | float) else ''


def _plain(text: str) -> str:
    return text.replace('`', '')


def _number(values: Mapping[str, str], name: str) -> float:
    try:
        return max(0.0, float(values.get(name, '') or 0.0))
    except ValueError:
        return 0.0


def _parsed(text: str) -> Mapping[str, Any]:
    try:
        found = json.loads(text) if text else {}
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}
