# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Progress of long jobs on stderr: bars on a terminal, else a line every few seconds."""

from collections.abc import Iterator
from contextlib import contextmanager
import time

from rich.console import Console
from rich.progress import BarColumn
from rich.progress import MofNCompleteColumn
from rich.progress import Progress as Bars
from rich.progress import TaskID
from rich.progress import TextColumn
from rich.progress import TimeElapsedColumn
from rich.progress import TimeRemainingColumn

from ivfmc_ros.cli.support.output import console
from ivfmc_ros.progress import Progress

# Seconds where stderr is not a terminal: between two lines, and before the first one, so that a
# short job that fails prints its error only.
LINE_INTERVAL = 5.0
QUIET_START = 2.0
# Seconds after which a line is repeated although it says the same: the job is alive.
REPEAT_INTERVAL = 30.0


@contextmanager
def progress_bars() -> Iterator[Progress]:
    """Show the progress of each stage on stderr while the block runs."""
    stderr = console(stderr=True)
    if not stderr.is_terminal:
        yield ProgressLines(stderr)
        return
    columns = (
        TextColumn('{task.description:>14}'),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    # transient: an error in mid-job is one line, without the remains of a bar before it
    with Bars(*columns, console=stderr, transient=True) as bars:
        tasks: dict[str, TaskID] = {}

        def show(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=total)
            bars.update(tasks[stage], completed=done, total=total)

        yield show


class ProgressLines:
    """Writes progress as lines: one when a stage begins, then one every ``LINE_INTERVAL``."""

    def __init__(self, stream: Console) -> None:
        self._stream = stream
        self._stage = self._text = ''
        self._begin = time.monotonic()
        self._due = 0.0

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Take the progress of a stage."""
        self.line(stage, f'{stage}: {done} of {total}')

    def line(self, stage: str, text: str) -> None:
        """Write ``text`` if ``stage`` is new or the interval is over."""
        now = time.monotonic()
        if now < self._begin + QUIET_START or (stage == self._stage and now < self._due):
            return
        if text == self._text and now < self._due - LINE_INTERVAL + REPEAT_INTERVAL:
            return
        self._stage, self._text, self._due = stage, text, now + LINE_INTERVAL
        self._stream.print(text)
