# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Writes the pages of docs/ that are made from the code and from the figures of ``make bench``.

``python docs/generate.py reference`` asks every node for its parameters and lists the codes.
``python docs/generate.py figures`` turns build/bench/*.json into the tables of docs/accuracy/.
``--check`` writes nothing and fails if a page of the reference differs from the code.
"""

import argparse
from collections.abc import Iterator
from collections.abc import Sequence
from importlib import import_module
import json
import os
from pathlib import Path
import sys
from typing import Any

DOCS = Path(__file__).resolve().parent
FIGURES = DOCS.parent / 'build' / 'bench'
NODES = {
    'orchestrator': 'Orchestrator',
    'triangulator': 'Triangulator',
    'registrar': 'Registrar',
    'mesher': 'Mesher',
    'recorder': 'Recorder',
    'camera': 'CameraNode',
    'turntable': 'TurntableNode',
    'window': 'Window',
}
NOTE = '<!-- Made by docs/generate.py: change the code and run `make reference`. -->\n\n'
# rclpy declares these by itself
_OF_RCLPY = ('use_sim_time', 'start_type_description_service')


def main(arguments: Sequence[str] | None = None) -> int:
    """Write or check the pages; the exit code is 1 if a page is not what the code says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('what', choices=('reference', 'figures'))
    parser.add_argument('--check', action='store_true')
    options = parser.parse_args(arguments)
    pages = reference() if options.what == 'reference' else figures()
    stale = []
    for path, text in pages:
        if options.check and (not path.exists() or path.read_text(encoding='utf-8') != text):
            stale.append(path)
        if not options.check:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding='utf-8')
    for path in stale:
        print(f'{path.relative_to(DOCS.parent)}: not what the code says; run `make reference`')
    return 1 if stale else 0


def reference() -> Iterator[tuple[Path, str]]:
    """Pages of parameters and codes, and the parameters as JSON for ``ivfmc up --set``."""
    folder = DOCS / 'reference'
    declared = declarations()
    yield folder / 'parameters.md', NOTE + parameters(declared)
    yield folder / 'codes.md', NOTE + codes()
    names = {node: sorted(found) for node, found in declared.items()}
    yield DOCS.parent / 'config' / 'parameters.json', json.dumps(names, indent=2) + '\n'


def declarations() -> dict[str, dict[str, tuple[str, ...]]]:
    """Every parameter of every node, as the node declares it: default, allowed, meaning."""
    import rclpy

    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    found = {}
    rclpy.init()
    try:
        for name, kind in NODES.items():
            node = getattr(import_module(f'ivfmc_ros.nodes.{name}'), kind)()
            found[name] = dict(_declared(node))
            node.destroy_node()
    finally:
        rclpy.try_shutdown()
    return found


def parameters(declared: dict[str, dict[str, tuple[str, ...]]]) -> str:
    """Page with a table for each node."""
    parts = [
        '# Parameters\n',
        'All lengths are meters, angles radians, times seconds. `ros2 param describe` says the '
        'same of a running node. A value out of range is refused with the reason. *at start*: '
        'the parameter cannot be set while the node runs.\n',
    ]
    head = ('name', 'default', 'allowed', 'meaning')
    for node, rows in declared.items():
        body = [(f'`{name}`', *row) for name, row in rows.items()]
        parts += [f'## {node}\n', table(iter([head, *body]))]
    return '\n'.join(parts)


def _declared(node: Any) -> Iterator[tuple[str, tuple[str, ...]]]:
    for name in sorted(node._parameters, key=list(node._parameters).index):
        if name in _OF_RCLPY or name.startswith('qos_overrides.'):
            continue
        descriptor = node.describe_parameter(name)
        meaning = descriptor.description + (' *at start*' if descriptor.read_only else '')
        yield name, (f'`{_value(node.get(name))}`', _allowed(descriptor), meaning)


def _value(value: Any) -> str:
    if isinstance(value, float):
        return f'{value:g}' if value != int(value) else f'{value:.1f}'
    return "''" if value == '' else str(value)


def _allowed(descriptor: Any) -> str:
    for limits in (*descriptor.floating_point_range, *descriptor.integer_range):
        return f'{limits.from_value:g} to {limits.to_value:g}'
    return str(descriptor.additional_constraints)


def codes() -> str:
    """Every code of an answer."""
    from ivfmc_ros.codes import CODES

    rows = [('code', 'meaning', 'what the caller does')]
    rows += [(f'`{name}`', code.meaning, code.action) for name, code in CODES.items()]
    return (
        '# Codes\n\n'
        'Every answer of a service, `scan_status` and every error of the command line has one of '
        'these. What a node answers to the orchestrator is passed on with its code.\n\n'
        + table(iter(rows))
    )


def figures() -> Iterator[tuple[Path, str]]:
    """One page for each result of ``make bench``."""
    for path in sorted(FIGURES.glob('*.json')):
        rows = [('figure', 'value', 'unit', 'bar', 'met', 'note')]
        for entry in json.loads(path.read_text(encoding='utf-8')):
            met = {True: 'yes', False: '**no**', None: ''}[entry['ok']]
            value = '' if entry['value'] is None else f'{entry["value"]:.4g}'
            cells = (entry['name'], value, entry['unit'], entry['bar'] or '', met, entry['note'])
            rows.append(tuple(map(str, cells)))
        title = f'# `make bench NAME={path.stem}`\n\n'
        page = NOTE_FIGURES + title + table(iter(rows))
        if path.stem == 'faults':
            page += ''.join(fault_tables())
        yield DOCS / 'accuracy' / f'{path.stem}.md', page


def fault_tables() -> Iterator[str]:
    """Yield the tables that `make faults` writes besides its figures, each with a heading."""
    for path in sorted((FIGURES / 'faults').glob('*.json')):
        rows = [tuple(row) for row in json.loads(path.read_text(encoding='utf-8'))]
        yield f'\n## {FAULT_TABLES.get(path.stem, path.stem)}\n\n{table(iter(rows))}'


FAULT_TABLES = {
    'matrix': 'Faults in a cell of real processes',
    'matrix_homing': 'Faults while the table is homed',
    'sequences': 'Sequences of two events',
}


NOTE_FIGURES = '<!-- Made by `make figures` from build/bench; not written by hand. -->\n\n'


def table(rows: Iterator[tuple[str, ...]]) -> str:
    """Return rows, the first of which is the head, as a table of Markdown."""
    head, *body = rows
    lines = [head, tuple('---' for _ in head), *body]
    return ''.join('| ' + ' | '.join(map(_cell, row)) + ' |\n' for row in lines)


def _cell(text: str) -> str:
    return ' '.join(text.split()).replace('|', '\\|').replace('<=', '≤').replace('>=', '≥')


if __name__ == '__main__':
    sys.exit(main())
