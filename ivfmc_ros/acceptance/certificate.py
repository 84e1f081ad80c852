# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One-page certificate of an acceptance test: PDF, PNG and HTML with the same contents."""

import base64
from collections.abc import Mapping
from html import escape
import io
from pathlib import Path
from typing import Any

import numpy as np

from ivfmc_ros import files
from ivfmc_ros.acceptance.check import Check
from ivfmc_ros.model import Floats

_A4 = (8.27, 11.69)  # inch
_COLORS = {'pass': '#1a7f37', 'fail': '#b42318', 'not decided': '#9a6700'}
_DOTS = 6000  # of the figure; more only cost time
_COLUMNS = ('characteristic', 'error', 'limit', 'U (k=2)', 'stated U', '|E|/U', 'verdict')
_WIDTHS = (0.4, 0.1, 0.09, 0.1, 0.1, 0.08, 0.13)
_NOTES = (
    'Error and limit in micrometers. U: expanded uncertainty of the test value (artifact and '
    'temperature). Stated U: what the calibration of the cell states for this quantity; |E|/U '
    'compares the error with both, at most 1 confirms the statement.',
    'Verdicts by ISO 14253-1 with the uncertainty of the test value (ISO 14253-5). '
    'Characteristics after VDI/VDE 2634 part 3 and ISO 10360-13 in reduced extent: one artifact '
    'in the positions scanned, the merged mesh as point set without vertices whose stated U is '
    'above the limit; the form leaves out 3 per mille of the points (VDI/VDE), D95% 5 % (ISO).',
)


def write_certificate(folder: Path, check: Check, document: Mapping[str, Any]) -> list[Path]:
    """
    Write certificate.pdf, certificate.png and certificate.html; return their paths.

    document : from ``check_document``
    :raises FileError: a file cannot be written
    """
    figure = _page(check, document)
    written = []
    for suffix in ('pdf', 'png'):
        path = folder / f'certificate.{suffix}'
        with files.atomic_file(path) as temporary:
            figure.savefig(temporary, format=suffix, dpi=110)
        written.append(path)
    path = folder / 'certificate.html'
    files.write_text(path, _html(check, document))
    return [*written, path]


def _page(check: Check, document: Mapping[str, Any]) -> Any:
    # imported here: the import takes 0.5 s, and not every command draws
    from matplotlib.figure import Figure

    figure = Figure(figsize=_A4, dpi=110)
    figure.text(
        0.08, 0.945, 'Acceptance test of a laser-stripe scanner', fontsize=16, weight='bold'
    )
    verdict = document['verdict']
    figure.text(0.92, 0.945, verdict.upper(), fontsize=16, weight='bold', ha='right',
                color=_COLORS.get(verdict, 'black'))  # fmt: skip
    for row, (name, value) in enumerate(_facts(document)):
        y = 0.905 - 0.021 * row
        figure.text(0.08, y, name, fontsize=9, color='0.35')
        figure.text(0.29, y, value, fontsize=9)
    _draw_table(figure, document)
    _draw_deviations(figure, check)
    _draw_histogram(figure, check)
    for row, note in enumerate(_NOTES):
        figure.text(0.08, 0.135 - 0.042 * row, _wrapped(note, 118), fontsize=7, va='top')
    return figure


def _facts(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    coverage = ', '.join(f'{share:.0%}' for share in document['coverage'])
    measured = f'{document["points"]}'
    if document['left_out']:
        measured += f'; {document["left_out"]:.0%} left out, whose own U is above the limit'
    return [
        ('artifact', f'{document["artifact"]}, u = {document["artifact_u_m"] * 1e6:.2g} um'),
        ('date', document['created']),
        ('calibration of the cell', document['calibration'] or 'not known'),
        ('measured', _shortened(str(document['source']))),
        ('points', measured + (f'; surface seen: {coverage}' if coverage else '')),
        (
            'temperature',
            f'{document["temperature_c"]:g} C, u = {document["temperature_u_k"]:g} K; '
            f'expansion {document["expansion_per_k"] * 1e6:g} um/(m K); lengths at 20 C',
        ),
    ]


def _shortened(text: str, most: int = 70) -> str:
    return text if len(text) <= most else f'...{text[3 - most :]}'


def _cells(document: Mapping[str, Any]) -> list[list[str]]:
    rows = []
    for one in document['characteristics']:
        stated, ratio = one['u_cell_m'], one['normalized_error']
        sign = '+' if one['nominal_m'] else ''
        rows.append(
            [
                f'{one["symbol"].split()[0]}  {one["name"]}',
                # no minus sign before zero
                f'{round(one["value_m"] * 1e6, 1) + 0.0:{sign}.1f}',
                f'{one["limit_m"] * 1e6:.0f}',
                f'{2e6 * one["u_test_m"]:.1f}',
                '-' if stated is None else f'{2e6 * stated:.1f}',
                '-' if ratio is None else f'{ratio:.2f}',
                one['verdict'],
            ]
        )
    return rows


def _draw_table(figure: Any, document: Mapping[str, Any]) -> None:
    rows = _cells(document)
    height = 0.024 * (len(rows) + 1)
    axes = figure.add_axes((0.08, 0.765 - height, 0.84, height))
    axes.axis('off')
    table = axes.table(
        cellText=rows, colLabels=_COLUMNS, colWidths=_WIDTHS, cellLoc='right', bbox=(0, 0, 1, 1)
    )
    table.auto_set_font_size(False)
    table.set_fontsize(7.5)
    for (row, column), cell in table.get_celld().items():
        cell.set_edgecolor('0.8')
        if column == 0:
            cell.set_text_props(ha='left')
            cell.PAD = 0.03
        if row == 0:
            cell.set_facecolor('#eef1f5')
        elif column == len(_COLUMNS) - 1:
            cell.set_text_props(color=_COLORS.get(rows[row - 1][-1], 'black'), weight='bold')


def _draw_deviations(figure: Any, check: Check) -> None:
    """Draw the points from the side and from above, colored by their deviations."""
    points, deviations = _few(check.points_xyz, check.deviations)
    limit = max(float(np.percentile(np.abs(deviations), 99)), 1e-7) * 1e6
    for bottom, height, up, name in ((0.43, 0.16, 2, 'z'), (0.19, 0.2, 1, 'y')):
        axes = figure.add_axes((0.1, bottom, 0.5, height))
        dots = axes.scatter(points[:, 0] * 1e3, points[:, up] * 1e3, c=deviations * 1e6, s=2,
                            cmap='coolwarm', vmin=-limit, vmax=limit, linewidths=0)  # fmt: skip
        axes.set(xlabel='x, mm', ylabel=f'{name}, mm', aspect='equal')
        axes.tick_params(labelsize=7)
    scale = figure.add_axes((0.68, 0.55, 0.24, 0.012))
    figure.colorbar(dots, cax=scale, orientation='horizontal', label='deviation, um')
    scale.tick_params(labelsize=7)


def _draw_histogram(figure: Any, check: Check) -> None:
    axes = figure.add_axes((0.68, 0.22, 0.24, 0.24))
    values = check.deviations * 1e6
    low, high = np.percentile(values, [0.15, 99.85])
    axes.hist(np.clip(values, low, high), bins=50, color='#1f77b4')
    axes.set(xlabel='deviation, um', title=f'{len(values)} points')
    axes.set_yticks([])
    axes.tick_params(labelsize=7)
    axes.title.set_fontsize(9)


def _few(points: Floats, deviations: Floats) -> tuple[Floats, Floats]:
    step = max(1, len(points) // _DOTS)
    return points[::step], deviations[::step]


def _wrapped(text: str, width: int) -> str:
    lines, line = [], ''
    for word in text.split():
        if len(line) + len(word) + 1 > width:
            lines.append(line)
            line = word
        else:
            line = f'{line} {word}'.strip()
    return '\n'.join([*lines, line])


def _html(check: Check, document: Mapping[str, Any]) -> str:
    """Return the certificate as one HTML page without references to other files."""
    facts = ''.join(
        f'<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>'
        for name, value in _facts(document)
    )
    head = ''.join(f'<th>{escape(name)}</th>' for name in _COLUMNS)
    body = ''.join(
        '<tr>' + ''.join(f'<td>{escape(cell)}</td>' for cell in row) + '</tr>'
        for row in _cells(document)
    )
    verdict = document['verdict']
    notes = ''.join(f'<p class="note">{escape(note)}</p>' for note in _NOTES)
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<title>Acceptance test</title><style>'
        'body{font:15px/1.5 system-ui,sans-serif;max-width:52rem;margin:2rem auto;padding:0 1rem}'
        'table{border-collapse:collapse;margin:1rem 0;width:100%}'
        'th,td{border:1px solid #d0d7de;padding:.3rem .6rem;text-align:right}'
        'th:first-child,td:first-child,.facts td{text-align:left}.note{font-size:.8rem;color:#555}'
        f'.verdict{{color:{_COLORS.get(verdict, "black")};float:right}}'
        'img{max-width:100%}</style></head><body>'
        f'<h1>Acceptance test <span class="verdict">{escape(verdict)}</span></h1>'
        f'<table class="facts">{facts}</table>'
        f'<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'
        f'<img alt="points and deviations" src="data:image/png;base64,{_picture(check)}">'
        f'{notes}</body></html>\n'
    )


def _picture(check: Check) -> str:
    from matplotlib.figure import Figure

    figure = Figure(figsize=_A4, dpi=110)
    _draw_deviations(figure, check)
    _draw_histogram(figure, check)
    stream = io.BytesIO()
    figure.savefig(stream, format='png', bbox_inches='tight')
    return base64.b64encode(stream.getvalue()).decode()
