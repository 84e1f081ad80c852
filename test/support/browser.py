# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Headless Chromium of the system, driven by Playwright."""

from collections.abc import Iterator
from contextlib import contextmanager
import shutil
import time
from typing import Any

import pytest

# WebGL by the processor, and no sandbox, which root cannot have.
_OPTIONS = ('--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader')
# Small: each pixel of the 3-D view costs the processor, which the cell needs too.
_SIZE = {'width': 900, 'height': 600}


@contextmanager
def browser(count: int = 1) -> Iterator[list[Any]]:
    """
    Yield pages of so many browser windows, each with a list ``errors`` of its console.

    Skips the test where there is no Chromium.
    """
    path = shutil.which('chromium') or shutil.which('chromium-browser')
    if path is None:
        pytest.skip('needs Chromium: apt-get install chromium')
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=path, args=[*_OPTIONS, '--no-sandbox']
        )
        try:
            yield [_page(chromium) for _ in range(count)]
        finally:
            chromium.close()


def _page(chromium: Any) -> Any:
    page = chromium.new_page(viewport=_SIZE)
    page.errors = []
    page.on('console', lambda message: _note(page, message))
    page.on('pageerror', lambda error: page.errors.append(str(error)))
    return page


def _note(page: Any, message: Any) -> None:
    if message.type == 'error':
        page.errors.append(message.text)


def open_page(page: Any, address: str, seconds: float = 60.0) -> None:
    """Open a page whose server may be starting."""
    from playwright.sync_api import Error

    deadline = time.monotonic() + seconds
    while True:
        try:
            page.goto(address)
            return
        except Error:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.3)
