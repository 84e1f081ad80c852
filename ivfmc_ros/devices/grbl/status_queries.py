# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""When the status of a GRBL controller is queried, and when it has been silent for too long."""

# Seconds between status queries. GRBL's interface description allows 5 to 10 a second.
_PERIOD_ACTIVE = 0.125  # while the axis moves, or a laser is on
_PERIOD_STANDING = 0.25
_PERIOD_WAITING = 0.06  # short, while a command waits for a report
# Seconds without a report after a query until the controller is lost. GRBL answers a query within
# 20 ms, and the scan has to end within 2 s.
_SILENCE_TIMEOUT = 1.0
# ... while a laser is on: with one period before the silence and one behind it, the beam is off
# within a second.
_LIT_SILENCE_TIMEOUT = 0.65


class StatusQueries:
    """
    Times of queries and of what was heard, in seconds of the steady clock. Not thread safe.

    queried_at, heard_at : of the last query, of the last report; 0 before
    """

    def __init__(self) -> None:
        self.queried_at = self.heard_at = 0.0
        self._first_unanswered: float | None = None  # when the first query since then was sent

    @property
    def are_unanswered(self) -> bool:
        """Whether the last query has no report yet."""
        return self.queried_at > self.heard_at

    def due(self, now: float, *, waiting: bool, active: bool) -> bool:
        """
        Return whether a query is due, and if so note it as sent.

        waiting : a command waits for a report
        active : the axis moves, or a laser is on
        """
        period = _PERIOD_ACTIVE if active else _PERIOD_STANDING
        if now - self.queried_at < (_PERIOD_WAITING if waiting else period):
            return False
        self.queried_at = now
        if self._first_unanswered is None:
            self._first_unanswered = now
        return True

    def hear(self, now: float) -> None:
        """Note that the controller answered."""
        self.heard_at = now
        self.forget()

    def forget(self) -> None:
        """Expect no report to earlier queries."""
        self._first_unanswered = None

    def resume(self, now: float) -> None:
        """Begin anew after a time without queries."""
        self.queried_at = now
        self.hear(now)

    def are_silent(self, *, lit: bool) -> bool:
        """Return whether a query stayed without report for too long; ``lit`` : a laser is on."""
        # of queries, not of the clock: a process that was stopped has not asked meanwhile
        first = self._first_unanswered
        limit = _LIT_SILENCE_TIMEOUT if lit else _SILENCE_TIMEOUT
        return first is not None and self.queried_at - first > limit
