# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What commands print: tables and lines for a person, or one JSON document for a program."""

from collections.abc import Callable
import json
import math
from typing import Any
from typing import TypeVar

import click
from rich.console import Console

Command = TypeVar('Command', bound=Callable[..., Any])

# Characters. A pipe or file has no width: rich would assume 80 and cut what is longer.
_ENDLESS_WIDTH = 100_000

json_option = click.option(
    '--json', 'as_json', is_flag=True, help='Print one JSON document instead of tables.'
)

pdf_option = click.option(
    '--pdf',
    is_flag=True,
    help='Also write report.pdf, of at most four A4 pages; needs Chromium or Chrome.',
)


def console(*, stderr: bool = False, markup: bool = False) -> Console:
    """
    Return a console that cuts and wraps nothing where the output is not a terminal.

    Markup is off by default, because file names may look like it.
    """
    made = Console(stderr=stderr, markup=markup, highlight=False)
    if not made.is_terminal:
        made = Console(stderr=stderr, markup=markup, highlight=False, width=_ENDLESS_WIDTH)
    return made


def print_json(document: Any) -> None:
    """Print a document; NaN and infinity become null, because JSON has neither."""
    click.echo(json.dumps(_finite(document), indent=2, default=str, allow_nan=False))


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value
