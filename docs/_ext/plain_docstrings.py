# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Turns the plain docstrings of this package into reStructuredText for Sphinx.

A docstring here is text in paragraphs. A line ``name : meaning`` describes an argument or a field,
and may go on in indented lines; ``:raises Error:`` lines stay as they are. Everything else is
plain text, in which only ````literals```` are markup: other characters that mean something to
reStructuredText are escaped.
"""

from collections.abc import Iterator
import re
from typing import Any

_FIELD = re.compile(r'^(?P<names>\*{0,2}\w+(?:\.\w+)*(?:, \w+(?:\.\w+)*)*) : (?P<text>.*)$')
_RAISES = re.compile(r'^:(?P<what>raises [\w.]+|returns?|return): ?(?P<text>.*)$')
_INLINE_FIELD = re.compile(r'; (?=\w+(?:, \w+)* : )')
_LITERAL = re.compile(r'(``.+?``)')
_SPECIAL = re.compile(r'([*`|\\]|(?<=\w)_(?!\w))')


def escape(text: str) -> str:
    """Escape what reStructuredText would take for markup, outside of literals."""
    parts = _LITERAL.split(text)
    return ''.join(
        part if part.startswith('``') else _SPECIAL.sub(r'\\\1', part) for part in parts
    )


def to_rst(lines: list[str]) -> list[str]:
    """Return the lines of a plain docstring as reStructuredText."""
    out: list[str] = []
    for block in _blocks(lines):
        if block[0].endswith('::') or block[0].startswith('    '):
            out += _preformatted(block)
        else:
            out += _paragraph(block)
        out.append('')
    return out


def _blocks(lines: list[str]) -> Iterator[list[str]]:
    block: list[str] = []
    for line in lines:
        if line.strip():
            block.append(line.rstrip())
        elif block:
            yield block
            block = []
    if block:
        yield block


def _preformatted(block: list[str]) -> list[str]:
    return ['::', '', *(f'    {line}' for line in block)]


def _paragraph(block: list[str]) -> list[str]:
    """Join the lines of each field and of the text between them."""
    items: list[tuple[str, str]] = []
    for line in block:
        for part in _INLINE_FIELD.split(line) if _FIELD.match(line) else [line]:
            field, raises = _FIELD.match(part), _RAISES.match(part.strip())
            if field:
                names = field['names'].strip('*').split(', ')
                # the text belongs to the last name, because it may go on in the lines that follow
                items += [(f':param {name}:', f'see {names[-1]}') for name in names[:-1]]
                items.append((f':param {names[-1]}:', field['text']))
            elif raises:
                items.append((f':{raises["what"]}:', raises['text']))
            elif items and (line.startswith(' ') or not items[-1][0]):
                items[-1] = (items[-1][0], f'{items[-1][1]} {part.strip()}')
            else:
                items.append(('', part.strip()))
    return _rendered(items)


def _rendered(items: list[tuple[str, str]]) -> list[str]:
    out: list[str] = []
    for head, text in items:
        is_new_kind = out and out[-1] and (not head or not out[-1].startswith(':'))
        out += [''] if is_new_kind else []
        if not head and re.match(r'^([-*+•]|\d+\.) ', text):
            out.append(f'| {escape(text)}')
        else:
            out.append(f'{head} {escape(text)}'.strip() if head else escape(text))
    return out


def _process(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    lines[:] = to_rst(lines)


def setup(app: Any) -> dict[str, bool]:
    """Register the conversion with Sphinx."""
    app.connect('autodoc-process-docstring', _process)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
