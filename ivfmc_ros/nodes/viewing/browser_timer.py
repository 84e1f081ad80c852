# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A timer of a node that rests while no browser shows its page."""

from collections.abc import Callable
from typing import Any

from ivfmc_ros.nodes.framework.base import CellNode


class BrowserTimer:
    """
    Calls ``follow`` periodically while a browser shows the page, and once after the last one left.

    ``follow`` gets whether there is a browser.
    """

    def __init__(
        self, node: CellNode, page: Any, period_s: float, follow: Callable[[bool], object]
    ) -> None:
        self._node, self._page, self._follow = node, page, follow
        # runs until the first look: a browser may have been faster than this node
        self._timer = node.steady_timer(period_s, self._look)
        page.on_browser(self._wake)

    @property
    def resting(self) -> bool:
        """Whether nothing is called until a browser comes."""
        return bool(self._timer.is_canceled())

    def _look(self) -> None:
        # before the look at the browsers: one that comes after it wakes the timer again
        self._timer.cancel()
        has_browser = self._page.browsers > 0
        if has_browser:
            self._timer.reset()
        self._follow(has_browser)

    def _wake(self) -> None:
        """Go on; called in a thread of the page."""
        executor = self._node.executor
        # None before the node runs, when the timer has not looked yet
        if executor is not None:
            executor.create_task(self._timer.reset)
