# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Renders the reports of ended scans one after the other, while the node goes on."""

from collections import deque
from collections.abc import Callable
from pathlib import Path

from ivfmc_ros.errors import CancelledError
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.scan.report import ReportRenderer


class ReportQueue:
    """The reports that wait, and the process that renders one of them."""

    def __init__(self, node: CellNode, ended: Callable[[Path, str], None]) -> None:
        """
        Start without a report.

        ended : called with the folder of a scan, and why its report could not be rendered, or ''
        """
        self._node = node
        self._ended = ended
        self._renderer = ReportRenderer()
        self._waiting: deque[Path] = deque()
        self._busy = False

    def add(self, folder: Path) -> None:
        """Render the report of a scan when those before it are done."""
        self._waiting.append(folder)
        if not self._busy:
            self._busy = True
            self._node.executor.create_task(self._work)

    def close(self) -> None:
        """Kill the process; what waits is rendered at the next start of the node."""
        self._waiting.clear()
        self._renderer.close()

    async def _work(self) -> None:
        try:
            while self._waiting:
                folder = self._waiting.popleft()
                error = await self._node.in_thread(self._renderer.render, folder)
                self._ended(folder, error)
        except CancelledError:
            # the node ends
            return
        except Exception as error:  # a report must not end the executor
            self._node.fault('report', error)
        finally:
            self._busy = False
