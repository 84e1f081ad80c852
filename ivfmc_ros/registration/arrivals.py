# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Profiles as they arrive, and the views that have ended among them."""

from collections import defaultdict
from collections.abc import Iterable

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Profile
from ivfmc_ros.model import View
from ivfmc_ros.registration.incremental import Incremental

# A view of which none of the last profiles is one has ended: lasers may take turns.
_SINCE = 6


class Arrivals:
    """
    The views of a scan that are placed while it still runs.

    ``place`` may run in a thread of its own, one at a time; the others are for the executor.
    """

    def __init__(self) -> None:
        self._of_view: dict[int, list[Profile]] = defaultdict(list)
        self._last: dict[int, int] = {}
        self._count = 0
        self._busy = False
        self._placed = Incremental()

    @property
    def poses(self) -> dict[int, Floats]:
        """(4, 4) correction of every view that was placed, by its number."""
        return dict(self._placed.poses)

    def add(self, profile: Profile) -> bool:
        """Take a profile; tell whether a view has ended that is not placed."""
        self._count += 1
        self._last[profile.view] = self._count
        if profile.view not in self._placed.poses:
            self._of_view[profile.view].append(profile)
        return self._ended() is not None

    def begin(self) -> bool:
        """Tell whether placing may begin: it has not, and there is something to place."""
        begins = not self._busy and self._ended() is not None
        self._busy |= begins
        return begins

    def end(self) -> None:
        """Say that placing has ended."""
        self._busy = False

    def next(self) -> list[Profile]:
        """Return the profiles of the first view that has ended; none if there is no such view."""
        number = self._ended()
        return [] if number is None else self._of_view.pop(number)

    def place(self, views: Iterable[View]) -> None:
        """Place the views that profiles of ``next()`` make on those before them."""
        for view in views:
            self._placed.add(view)

    def _ended(self) -> int | None:
        ended = [view for view in self._of_view if self._count - self._last[view] >= _SINCE]
        return min(ended, default=None)
