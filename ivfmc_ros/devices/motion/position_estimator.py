# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Axis position between the reports of its controller, by recursive least squares.

The positions of the commanded trajectory are right, its times are not: the move begins a little
late, and the clock of the controller runs a little fast or slow. Delay and clock scale are
estimated from the reported positions (recursive least squares with prior standard deviations,
which is a Kalman filter with a constant state).
"""

import math

from ivfmc_ros.devices.motion import trajectory
from ivfmc_ros.devices.motion.trajectory import Segment
from ivfmc_ros.devices.motion.trajectory import Trajectory

# Prior standard deviations: a ceramic resonator is good to 0.5 %, and a move begins within
# 20 ms of its acknowledgment. Measured over USB serial, a report is 5 ms early or late.
_SCALE_SIGMA = 0.005
_DELAY_SIGMA = 0.02  # seconds
_REPORT_SIGMA = 0.005  # seconds
_MIN_SCALE_SIGMA = 1e-4  # a resonator drifts by so much with its temperature
_SIGMA_GROWTH = 2.0  # of the scale's sigma from move to move, for the drift between them
_OUTLIER_SIGMAS = 5.0  # a report that is off by more was held up on its way

_BLEND_TIME = 0.5  # seconds over which a correction is faded in, so that the position never jumps
_MIN_SPEED_FRACTION = 0.5  # of the greatest speed; below it a position says little about the time


class PositionEstimator:
    """
    Position and velocity of an axis at any time, from its commanded trajectory and reports.

    Positions are in one unit of angle, times are steady seconds. The clock scale is kept for
    the next move, the delay is not.
    """

    def __init__(self, position: float = 0.0) -> None:
        self._plan: Trajectory = trajectory.standstill(position)
        self._max_speed = 0.0
        self._start_time = 0.0
        self._scale = 1.0
        self._scale_sigma = _SCALE_SIGMA
        self._reset_estimate()
        self._correction, self._corrected_at = 0.0, -math.inf

    @property
    def scale(self) -> float:
        """Estimated controller seconds per second of this computer."""
        return self._scale

    @property
    def standing(self) -> bool:
        """Whether no motion is planned."""
        return len(self._plan) == 1

    @property
    def target(self) -> float:
        """Position at the end of the motion."""
        return self._plan[-1].position

    def set_standstill(self, position: float) -> None:
        """Set an axis that stands at ``position``."""
        self._plan = trajectory.standstill(position)
        self._corrected_at = -math.inf

    def begin(self, plan: Trajectory, time: float) -> None:
        """
        Begin a motion.

        plan : with times that count from 0
        time : when the controller acknowledged the move
        """
        self._plan, self._start_time = plan, time
        self._max_speed = max(abs(segment.velocity) for segment in plan)
        grown = self._scale_sigma * _SIGMA_GROWTH
        self._scale_sigma = max(min(grown, _SCALE_SIGMA), _MIN_SCALE_SIGMA)
        self._reset_estimate()
        self._corrected_at = -math.inf

    def brake(self, acceleration: float, time: float) -> None:
        """Replace the rest of the motion by braking from ``time`` on."""
        position, velocity = self.state_at(time)
        if velocity == 0.0:
            self.set_standstill(position)
            return
        present = (Segment(time=0.0, position=position, velocity=velocity),)
        self.begin(trajectory.brake(present, acceleration, 0.0), time)

    def update(self, time: float, position: float) -> None:
        """Update the estimate by a report that the axis was at ``position`` at ``time``."""
        plan_time = trajectory.time_at_position(self._plan, position)
        if plan_time is None:
            return
        speed = abs(trajectory.state_at(self._plan, plan_time)[1])
        if speed < _MIN_SPEED_FRACTION * self._max_speed:
            return
        before = self._plan_time(time)
        self._update_clock(time - self._start_time, plan_time)
        self._correction, self._corrected_at = before - self._uncorrected_time(time), time

    def state_at(self, time: float) -> tuple[float, float]:
        """Return the estimated (position, velocity)."""
        return trajectory.state_at(self._plan, self._plan_time(time))

    def lateness(self, time: float, position: float) -> float | None:
        """
        Return by how many seconds the axis passes ``position`` later than planned.

        None where the plan does not pass it, or too slowly to tell when.
        """
        plan_time = trajectory.time_at_position(self._plan, position)
        if self.standing or plan_time is None:
            return None
        speed = abs(trajectory.state_at(self._plan, plan_time)[1])
        if speed < _MIN_SPEED_FRACTION * self._max_speed:
            return None
        return (self._plan_time(time) - plan_time) / self._scale

    def delay(self, seconds: float) -> None:
        """Shift the rest of the motion to a later time."""
        self._start_time += seconds

    def has_ended(self, time: float) -> bool:
        """Return whether the motion should have ended by ``time``."""
        return self._plan_time(time) >= trajectory.end_time(self._plan)

    def _reset_estimate(self) -> None:
        # plan time = scale * (elapsed - delay); the state is (scale, scale * delay)
        self._scaled_delay = 0.0
        self._covariance = [[self._scale_sigma**2, 0.0], [0.0, _DELAY_SIGMA**2]]

    def _uncorrected_time(self, time: float) -> float:
        return self._scale * (time - self._start_time) - self._scaled_delay

    def _plan_time(self, time: float) -> float:
        """Return the plan's time at ``time``; the last correction is faded in."""
        if self.standing:
            return time
        remaining = 1 - (time - self._corrected_at) / _BLEND_TIME
        correction = self._correction * min(remaining, 1.0) if remaining > 0 else 0.0
        return self._uncorrected_time(time) + correction

    def _update_clock(self, elapsed: float, plan_time: float) -> None:
        """Update scale and delay by one observation: plan_time = scale * elapsed - delay."""
        (a, b), (_, c) = self._covariance
        gain_scale, gain_delay = a * elapsed - b, b * elapsed - c
        innovation_variance = gain_scale * elapsed - gain_delay + _REPORT_SIGMA**2
        innovation = plan_time - (self._scale * elapsed - self._scaled_delay)
        if innovation**2 > _OUTLIER_SIGMAS**2 * innovation_variance:
            return
        self._scale += gain_scale / innovation_variance * innovation
        self._scaled_delay += gain_delay / innovation_variance * innovation
        a -= gain_scale * gain_scale / innovation_variance
        b -= gain_scale * gain_delay / innovation_variance
        c -= gain_delay * gain_delay / innovation_variance
        self._covariance = [[a, b], [b, c]]
        self._scale_sigma = math.sqrt(max(a, 1e-12))
