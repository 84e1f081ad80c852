# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Profiles of a sweep whose pictures are taken on the pulses of the table's trigger line."""

from dataclasses import dataclass
import math

import numpy as np

from ivfmc_ros.devices.motion import trajectory
from ivfmc_ros.devices.motion.trajectory import Trajectory
from ivfmc_ros.model import Profile
from ivfmc_ros.simulation.trigger_line import TriggerLine
from ivfmc_ros.storage.matching.joint_history import JointHistory
from support.sweep import SECOND
from support.sweep import START
from support.synthetic import make_profile

# The camera ignores pulses during an exposure, seconds.
EXPOSURE_S = 0.005


@dataclass(frozen=True, kw_only=True)
class TriggeredSweep:
    """
    A turn of a table that triggers the camera.

    step, span : radians; negative span: the other direction
    speed, acceleration : rad/s and rad/s^2
    rate : reports of the position per second, which are 5 to 20 ms late
    drop, double, noise : faults of the trigger line, see TriggerLine
    lost : radians that the table loses against the reports in mid-sweep
    begin : seconds
    """

    step: float
    speed: float = math.radians(24.0)
    span: float = math.radians(360.0)
    acceleration: float = 2.0
    rate: float = 10.0
    drop: float = 0.0
    double: float = 0.0
    noise: float = 0.0
    lost: float = 0.0
    begin: float = 1.0
    seed: int = 0

    @property
    def motion(self) -> Trajectory:
        """True motion, radians."""
        lead = math.copysign(0.2, self.span)
        return trajectory.trapezoid(
            -lead, self.span + lead, self.speed, self.acceleration, self.begin
        )

    @property
    def pulses(self) -> list[float]:
        """Times of the pulses on which the camera exposes, seconds."""
        line = TriggerLine(self.step, self.seed)
        line.drop, line.double, line.noise = self.drop, self.double, self.noise
        line.move(0.0, self.motion)
        found: list[float] = []
        for time in line.advance(trajectory.end_time(self.motion) + 1.0):
            if not found or time - found[-1] > EXPOSURE_S:
                found.append(time)
        return found

    def true_angles(self, profiles: list[Profile]) -> np.ndarray:
        """Return the true angle of each profile, radians."""
        seconds = [(profile.stamp_ns - START) / SECOND for profile in profiles]
        return np.array([trajectory.state_at(self.motion, second)[0] for second in seconds])

    def profiles(self, view: int = 0, first_seq: int = 0) -> list[Profile]:
        """Return the profiles with the angles that the reports give."""
        rng = np.random.default_rng(self.seed)
        reports = JointHistory()
        end = trajectory.end_time(self.motion) + 1.0
        middle = 0.5 * (self.begin + end)
        for time in np.arange(0.0, end, 1.0 / self.rate):
            position, _ = trajectory.state_at(self.motion, time)
            position += self.lost if time > middle else 0.0
            received = time + rng.uniform(0.005, 0.020)
            reports.add(START + round(received * SECOND), position)
        found = []
        for seq, pulse in enumerate(self.pulses):
            stamp_ns = START + round(pulse * SECOND)
            # as the triangulator publishes it
            angle = float(np.float32(reports.position_at(stamp_ns)))
            c, s = np.cos(angle), np.sin(angle)
            point = [[0.05 * c, -0.05 * s, 0.01]]
            profile = make_profile(point, angle=angle, seq=first_seq + seq, view=view)
            changes = {'stamp_ns': stamp_ns, 'speed': reports.velocity_at(stamp_ns)}
            found.append(Profile(**{**vars(profile), **changes}))
        return found
