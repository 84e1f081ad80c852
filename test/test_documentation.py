# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""README and docs/ agree with the code: links, codes, topics, services, parameters."""

import ast
from pathlib import Path
import re
import subprocess
import sys

import pytest
from support import house
from support.house import PACKAGE
from support.house import ROOT

from ivfmc_ros import errors
from ivfmc_ros.codes import CODES

PAGES = [ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *sorted((ROOT / 'docs').rglob('*.md'))]
LINK = re.compile(r'(?<!\\)\]\(([^)#\s]+)(?:#[^)]*)?\)')
# Sphinx makes these while it builds
MADE = ('reference/api/',)


def links(page: Path) -> list[str]:
    text = re.sub(r'```.*?```', '', page.read_text(encoding='utf-8'), flags=re.DOTALL)
    return [link for link in LINK.findall(text) if not link.startswith(('http:', 'https:'))]


@pytest.mark.parametrize('page', PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_no_link_is_broken(page):
    made = tuple(str(ROOT / 'docs' / place) for place in MADE)
    targets = [(page.parent / link).resolve() for link in links(page)]
    assert [t for t in targets if not t.exists() and not str(t).startswith(made)] == []


def test_readme_is_short_and_its_picture_small():
    assert len((ROOT / 'README.md').read_text(encoding='utf-8').splitlines()) <= 200
    assert (ROOT / 'docs/images/demo.png').stat().st_size < 300_000


def test_every_page_of_the_documentation_is_reached_from_its_index():
    docs = ROOT / 'docs'
    listed = set()
    for page in docs.rglob('*.md'):
        for block in re.findall(r'```\{toctree\}\n(.*?)```', page.read_text(), re.DOTALL):
            for line in block.splitlines():
                if line and not line.startswith(':'):
                    listed |= set(page.parent.glob(f'{line}.md'))
    missing = set(docs.rglob('*.md')) - listed - {docs / 'index.md'}
    assert {page for page in missing if '_build' not in page.parts} == set()


def raised_codes() -> set[str]:
    """Codes that the sources give to errors and answers."""
    found = {
        value.code
        for value in vars(errors).values()
        if isinstance(value, type) and issubclass(value, errors.ScanError)
    }
    for path in house.sources(PACKAGE):
        for node in ast.walk(house.parse(path)):
            if isinstance(node, ast.Call) and getattr(node.func, 'id', '') == 'HelperError':
                code = node.args[0] if node.args else None
                if isinstance(code, ast.Constant) and isinstance(code.value, str):
                    found.add(code.value)
    return found - {''}


def test_every_code_is_explained_with_what_the_caller_does():
    assert raised_codes() - set(CODES) == set()
    assert len(raised_codes()) > 20
    assert all(code.meaning.endswith('.') and code.action.endswith('.') for code in CODES.values())


def declared_names() -> set[str]:
    """Topics and services that a node publishes, subscribes or offers under a literal name."""
    found = set()
    for path in (ROOT / PACKAGE / 'nodes').glob('*.py'):
        for node in ast.walk(house.parse(path)):
            if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
                continue
            if node.func.attr in ('publish_on', 'subscribe', 'trigger', 'serve'):
                words = [a.value for a in node.args if isinstance(a, ast.Constant)]
                found |= {word for word in words if isinstance(word, str)}
    return found


def test_every_topic_and_service_is_in_the_reference():
    page = (ROOT / 'docs/reference/topics.md').read_text(encoding='utf-8')
    names = declared_names()
    assert len(names) > 15
    assert {name for name in names if not re.search(rf'[`/]{re.escape(name)}\b', page)} == set()


def test_pages_that_are_made_from_the_code_are_as_it_says():
    pytest.importorskip('rclpy')
    command = [sys.executable, 'docs/generate.py', 'reference', '--check']
    result = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False
    )
    assert result.returncode == 0, result.stdout + result.stderr
