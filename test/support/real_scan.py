# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Runs the commands that the tutorial on calibration documents for the measured scan, in order."""

import os
from pathlib import Path
import re
import shlex
import subprocess
import sys
import time

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / 'docs/tutorials/calibrate-a-cell.md'
_BLOCK = re.compile(r'<!-- real scan -->\n```\w*\n(.*?)```', re.DOTALL)


def data_folder() -> Path:
    """Return where measured data are, if there are any."""
    return Path(os.environ.get('IVFMC_DATA', ROOT.parent / 'shared' / 'data'))


def measured_scan() -> Path | None:
    """Return the folder of the measured scan, or None where it is absent."""
    folder = data_folder() / 'turntable_laser'
    return folder if folder.is_dir() else None


def documented_commands() -> list[list[str]]:
    """Return the commands of the tutorial's block on a real scan, split into words."""
    found = _BLOCK.search(PAGE.read_text(encoding='utf-8'))
    if found is None:
        raise LookupError(f'{PAGE} has no block after <!-- real scan -->')
    text = found.group(1).replace('\\\n', ' ')
    return [shlex.split(line) for line in text.splitlines() if line.startswith('ivfmc ')]


def run_documented_commands(data: Path, folder: Path) -> dict[str, float]:
    """
    Run the commands in ``folder``, with ``data`` as the folder 'data' in it.

    returns : seconds by command, the first word after ivfmc (and the second of calibrate)
    """
    (folder / 'data').symlink_to(data)
    environment = {**os.environ, 'PYTHONPATH': str(ROOT)}
    seconds = {}
    for command in documented_commands():
        name = ' '.join(command[1:3]) if command[1] == 'calibrate' else command[1]
        start = time.perf_counter()
        subprocess.run(
            [sys.executable, '-m', 'ivfmc_ros.cli.main', *command[1:]],
            cwd=folder,
            env=environment,
            check=True,
            capture_output=True,
            text=True,
        )
        seconds[name] = time.perf_counter() - start
    return seconds
