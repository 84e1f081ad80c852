# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Prints a report page to PDF by the Chromium or Chrome of the computer.

The browser applies the print style sheet of the page itself, so that a printed page and the PDF
are the same; another library would need a second layout.
"""

from collections.abc import Sequence
import os
from pathlib import Path
import shutil
import subprocess
import tempfile

from ivfmc_ros import files
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import NotReadyError

BROWSERS = (
    'chromium',
    'chromium-browser',
    'google-chrome',
    'google-chrome-stable',
    'chrome',
    'microsoft-edge',
)
# Seconds for a page of 8 MB on a busy computer; an idle one takes a few.
_TIMEOUT_S = 600.0


def find_browser() -> str:
    """
    Return the path of a browser that can print.

    :raises NotReadyError: there is none
    """
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        raise NotReadyError(
            f'pdf: needs one of {", ".join(BROWSERS)} on the PATH; install chromium, or print '
            'report.html from any browser'
        )
    return found


def print_pdf(page: Path, target: Path) -> None:
    """
    Print a page as a PDF file of A4 pages.

    page : HTML file
    :raises NotReadyError: there is no browser
    :raises FileError: the page cannot be read, or the file not be written
    """
    browser = find_browser()
    if not page.is_file():
        raise FileError(f'{page}: file not found')
    with files.atomic_file(target) as temporary, tempfile.TemporaryDirectory() as profile:
        command = [
            browser,
            '--headless=new',
            '--disable-gpu',
            # the view that turns is not printed, and takes long without a graphics processor
            '--disable-3d-apis',
            '--no-first-run',
            '--disable-extensions',
            '--disable-background-networking',
            f'--user-data-dir={profile}',
            '--no-pdf-header-footer',
            f'--print-to-pdf={temporary.absolute()}',
            # the sandbox refuses to run as root
            *(['--no-sandbox'] if os.geteuid() == 0 else []),
            page.absolute().as_uri(),
        ]
        message = _run(command, target)
        with temporary.open('rb') as stream:
            if not stream.read(5) == b'%PDF-':
                raise FileError(f'{target}: {browser} wrote no PDF: {message}')


def _run(command: Sequence[str], target: Path) -> str:
    """Run the browser, and return the last line of its messages."""
    try:
        ran = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors='replace',
            timeout=_TIMEOUT_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise FileError(f'{target}: cannot be printed: {error}') from error
    return (ran.stderr.strip() or f'exit code {ran.returncode}').splitlines()[-1]
