# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Runs groups of figures, writes one JSON file a group and prints them as tables."""

import argparse
from collections.abc import Sequence
import importlib.util
import json
from pathlib import Path
import sys
import time

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from bench.number import Number
from ivfmc_ros.files import write_text

HERE = Path(__file__).resolve().parent
RESULTS = HERE.parents[1] / 'build' / 'bench'
PREFIX = 'bench_'
# Groups that take half an hour or more in real time; they run only by their name.
LONG = ('faults', 'resume', 'soak')


def main(arguments: Sequence[str] | None = None, *, folder: Path = HERE) -> int:
    """
    Run the groups that are named, or all but the long ones; returns the exit code.

    It is 1 if any bar is missed.
    """
    options = _parser().parse_args(arguments)
    available = find_groups(folder)
    unknown = [name for name in options.groups if name not in available]
    if unknown or not available:
        what = f'no bench group {", ".join(unknown)}' if unknown else 'no bench group at all'
        print(f'{what} in {folder}; there are: {", ".join(available) or "none"}', file=sys.stderr)
        return 1
    console = Console()
    names = options.groups or [name for name in available if name not in LONG]
    results = [run_group(name, available[name], options.output, console) for name in names]
    return 0 if all(results) else 1


def find_groups(folder: Path) -> dict[str, Path]:
    """Name and file of every group in ``folder``."""
    files = sorted(folder.glob(f'{PREFIX}*.py'))
    return {file.stem.removeprefix(PREFIX): file for file in files}


def run_group(name: str, file: Path, output: Path, console: Console) -> bool:
    """Measure one group; True if it ran to its end and no bar was missed."""
    result = output / f'{name}.json'
    # What an earlier run measured must not pass for this run's if this one breaks.
    result.unlink(missing_ok=True)
    started = time.monotonic()
    try:
        numbers = measure(name, file)
    except Exception:
        # One broken group must not cost the figures of the others.
        console.print(f'[bold red]{name} broke[/]')
        console.print_exception()
        return False
    write(result, numbers)
    console.print(as_table(f'{name} ({time.monotonic() - started:.1f} s)', numbers))
    console.print(f'written to {result}', soft_wrap=True)
    return all(number.ok is not False for number in numbers)


def measure(name: str, file: Path) -> list[Number]:
    """Load the group's module and call its ``run``."""
    spec = importlib.util.spec_from_file_location(f'{__package__}.{PREFIX}{name}', file)
    if spec is None or spec.loader is None:
        raise ImportError(f'{file} cannot be loaded')
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    numbers = []
    for number in module.run():
        numbers.append(number)
        # a group takes minutes: tell what is known so far
        print(f'{name}: {number}', file=sys.stderr, flush=True)
    strangers = [number for number in numbers if not isinstance(number, Number)]
    if strangers or not numbers:
        raise TypeError(f'{file}: run() has to give Number objects, gave {strangers or "none"}')
    return numbers


def write(file: Path, numbers: Sequence[Number]) -> None:
    """Write the figures as JSON."""
    file.parent.mkdir(parents=True, exist_ok=True)
    entries = [number.as_dict() for number in numbers]
    write_text(file, json.dumps(entries, indent=2, allow_nan=False) + '\n')


def as_table(title: str, numbers: Sequence[Number]) -> Table:
    """Show the figures as a person reads them."""
    table = Table(title=title, title_justify='left')
    for column in ('figure', 'value', 'unit', 'bar', 'ok', 'note'):
        table.add_column(column, justify='right' if column == 'value' else 'left')
    verdicts = {True: '[green]yes[/]', False: '[bold red]NO[/]', None: ''}
    for number in numbers:
        bar = '' if number.bar is None else str(number.bar)
        value = f'{number.value:.6g}'
        name, unit, note = (escape(text) for text in (number.name, number.unit, number.note))
        table.add_row(name, value, unit, bar, verdicts[number.ok], note)
    return table


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='bench', description=__doc__)
    parser.add_argument(
        'groups', nargs='*', metavar='GROUP', help=f'all but {", ".join(LONG)}, if none is named'
    )
    parser.add_argument('-o', '--output', type=Path, default=RESULTS, help='folder of the results')
    return parser
