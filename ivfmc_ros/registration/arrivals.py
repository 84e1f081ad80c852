# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Profiles of a running scan, grouped by view; completed views are registered incrementally."""

from collections import defaultdict
from collections.abc import Iterable

from ivfmc_ros.model import Floats
from ivfmc_ros.model import Profile
from ivfmc_ros.model import View
from ivfmc_ros.registration.incremental import IncrementalRegistration

# A view is complete when none of the last so many profiles belongs to it. More than one, because
# lasers may alternate from profile to profile.
_COMPLETE_AFTER = 6


class Arrivals:
    """
    Buffer of the profiles of a running scan, and the poses of the views registered so far.

    ``place`` may run in a thread of its own, one call at a time; the other methods are for the
    executor's thread.
    """

    def __init__(self) -> None:
        self._of_view: dict[int, list[Profile]] = defaultdict(list)
        self._last: dict[int, int] = {}
        self._count = 0
        self._busy = False
        self._registration = IncrementalRegistration()

    @property
    def poses(self) -> dict[int, Floats]:
        """(4, 4) pose correction of each registered view, by the number of the view."""
        return dict(self._registration.poses)

    def add(self, profile: Profile) -> bool:
        """Add a profile; return whether a complete view waits for its registration."""
        self._count += 1
        self._last[profile.view] = self._count
        if profile.view not in self._registration.poses:
            self._of_view[profile.view].append(profile)
        return self._complete() is not None

    def begin(self) -> bool:
        """Reserve the registration; False if one is running or no complete view waits."""
        begins = not self._busy and self._complete() is not None
        self._busy |= begins
        return begins

    def end(self) -> None:
        """Release the registration that ``begin`` reserved."""
        self._busy = False

    def next(self) -> list[Profile]:
        """Remove and return the profiles of the first complete view; empty if there is none."""
        number = self._complete()
        return [] if number is None else self._of_view.pop(number)

    def place(self, views: Iterable[View]) -> None:
        """Register views, made of the profiles of ``next``, to the views before them."""
        for view in views:
            self._registration.add(view)

    def _complete(self) -> int | None:
        """Return the lowest number of a complete view that is not registered; None if none."""
        complete = [
            view for view in self._of_view if self._count - self._last[view] >= _COMPLETE_AFTER
        ]
        return min(complete, default=None)
