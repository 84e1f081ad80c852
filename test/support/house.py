# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads the sources of the package, for the tests that guard its layout."""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = 'ivfmc_ros'

# Data flows down this list; a module imports only from rows above its own, or from its own.
ROWS = (
    'base',
    'cell',
    'stripe',
    'registration',
    'meshing',
    'calibration',
    'inspection',
    'acceptance',
    'storage',
    'devices',
    'simulation',
    'scan',
    'pipeline',
    'results',
    'window',
    'nodes',
    'cli',
    'examples',
)
BORDER = ('nodes', 'cli', 'examples')


def sources(*folders: str) -> list[Path]:
    """Every Python file below ``folders`` of the repository."""
    return sorted(path for folder in folders for path in (ROOT / folder).rglob('*.py'))


def parse(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding='utf-8'), filename=str(path))


def module_name(path: Path) -> str:
    """Dotted name of a file of the package."""
    parts = path.relative_to(ROOT).with_suffix('').parts
    return '.'.join(parts[:-1] if parts[-1] == '__init__' else parts)


def row_of(module: str) -> str:
    """
    Row of the house that ``module`` is in.

    A file of its own at the top (model, errors, helpers) is 'base', but pipeline and results.
    """
    _, _, inside = module.partition('.')
    first = inside.split('.')[0]
    folder = ROOT / PACKAGE / first
    return first if first in ('pipeline', 'results') or (first and folder.is_dir()) else 'base'


def imported_modules(tree: ast.Module, module: str, *, is_package: bool) -> Iterator[str]:
    """Absolute names of all that ``module`` imports, also inside functions."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            origin = _origin(node, module, is_package=is_package)
            # `from ivfmc_ros import cell` names a module by its alias
            yield from (f'{origin}.{alias.name}' for alias in node.names)


def _origin(node: ast.ImportFrom, module: str, *, is_package: bool) -> str:
    if not node.level:
        return node.module or ''
    parts = module.split('.')
    drop = node.level - 1 if is_package else node.level
    base = parts[: len(parts) - drop]
    return '.'.join([*base, node.module] if node.module else base)


def imports_of(path: Path) -> list[str]:
    """Absolute names of all that the package's file ``path`` imports."""
    is_package = path.name == '__init__.py'
    return list(imported_modules(parse(path), module_name(path), is_package=is_package))


def room_of(module: str, modules: set[str]) -> str:
    """Sub-package, or file of its package, that ``module`` is in; a name in it is cut off."""
    while module and module not in modules:
        module = module.rpartition('.')[0]
    return '.'.join(module.split('.')[:3])


def imports_between_rooms(paths: list[Path]) -> dict[str, set[str]]:
    """Which rooms each room of a package imports from the same package."""
    modules = {module_name(path) for path in paths}
    found: dict[str, set[str]] = {}
    for path in paths:
        room = room_of(module_name(path), modules)
        for name in imports_of(path):
            other = room_of(name, modules)
            depths = {room.count('.'), other.count('.')}
            if depths == {2} and other != room and row_of(other) == row_of(room):
                found.setdefault(room, set()).add(other)
    return found


def cycles(imports: dict[str, set[str]]) -> list[str]:
    """Those keys of ``imports`` that lead back to themselves."""
    return sorted(name for name in imports if name in _reached(name, imports))


def _reached(start: str, imports: dict[str, set[str]]) -> set[str]:
    seen: set[str] = set()
    waiting = [start]
    while waiting:
        new = imports.get(waiting.pop(), set()) - seen
        seen |= new
        waiting += new
    return seen
