# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A scan in step motion with a foreign camera and a foreign axis, on a simulated clock.

Messages arrive in the order of a graph. Commands, standstill, matching and triangulation are those
of our nodes; the stripe of each image is that of a sphere at the true angle, by the true laser.
"""

from dataclasses import dataclass
import math

import numpy as np
from sensor_msgs.msg import JointState

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.model import Frame
from ivfmc_ros.model import Profile
from ivfmc_ros.nodes.convert.stamps import nanoseconds
from ivfmc_ros.nodes.convert.trajectory import trajectory_to
from ivfmc_ros.scan.table_reports import TableReports
from ivfmc_ros.storage.matching.frame_matching import FrameMatch
from ivfmc_ros.storage.matching.frame_matching import FrameMatcher
from ivfmc_ros.storage.matching.frame_matching import MatchSettings
from ivfmc_ros.storage.matching.joint_history import joint_in_message
from ivfmc_ros.stripe.stripe import Stripe
from ivfmc_ros.stripe.triangulate import triangulate
from support.foreign_axis import ForeignAxis
from support.foreign_axis import JOINT
from support.foreign_camera import Driver
from support.foreign_camera import EXPOSURE_S
from support.synthetic import LASERS
from support.synthetic import Sphere

START_S = 1_790_000_000.0
# Periods of images, joint_states and laser_states, seconds.
_IMAGE_S, _JOINT_S, _LASER_S = 0.125, 0.005, 0.1
_TICK_S = 0.005
# Position tolerance of the bench cell, radians, and patience for a profile, seconds.
_TOLERANCE, _PATIENCE_S = 0.002, 5.0
NAMES = list(LASERS)


@dataclass(frozen=True)
class Exposure:
    """What an image shows: the true angle, rad, and the laser that was on, or none."""

    angle: float
    lasers: frozenset[str]


class ForeignScan:
    """
    The scan; ``run`` executes it.

    profiles : of both lasers
    reasons : why the other images were not used
    """

    def __init__(
        self, cell: Cell, sphere: Sphere, driver: Driver, stamp_delay: float, seed: int = 0
    ) -> None:
        self._cell, self._sphere, self._driver = cell, sphere, driver
        self.axis = ForeignAxis(seed)
        self._matcher = FrameMatcher(
            NAMES, MatchSettings(motion='step', exposure=EXPOSURE_S, stamp_delay=stamp_delay)
        )
        self._rng = np.random.default_rng(seed)
        self._now_s = START_S
        self._due_s = dict.fromkeys(('image', 'joints', 'lasers'), START_S)
        self._laser = ''
        self._arriving: list[tuple[float, int, Exposure]] = []
        self._images = 0
        self.profiles: list[Profile] = []
        self.reasons: list[str] = []
        self.table = TableReports()

    def run(self, steps: int) -> None:
        """Take a profile by each laser at equal steps of a turn."""
        self._wait(lambda: self.table.last is not None)
        for step in range(steps):
            target = 2.0 * math.pi * step / steps
            if step:
                self.move(target, 0.8)
                self._wait(lambda target=target: self.table.stands_at(target, _TOLERANCE))
            for laser in NAMES:
                known = len(self.profiles)
                self._switch(laser)
                self._wait(lambda known=known: len(self.profiles) > known)
            self._switch('')

    def _wait(self, condition) -> None:
        end_s = self._now_s + _PATIENCE_S
        while not condition():
            assert self._now_s < end_s, f'not within {_PATIENCE_S} s: {self.reasons[-5:]}'
            self._tick()

    def move(self, target: float, seconds: float) -> None:
        """Command the axis to ``target`` (radians) within ``seconds``."""
        self.table.begin_move()
        self.axis.command(trajectory_to(JOINT, target, seconds), self._now_s)

    def _switch(self, laser: str) -> None:
        self._laser = laser
        self._report_lasers()

    def _tick(self) -> None:
        now_s = self._now_s = self._now_s + _TICK_S
        if self._is_due('image', _IMAGE_S):
            self._expose(now_s)
        if self._is_due('joints', _JOINT_S):
            self._receive_joints(self.axis.joint_states(now_s))
        if self._is_due('lasers', _LASER_S):
            self._report_lasers()
        for one in [one for one in self._arriving if one[0] <= now_s]:
            self._arriving.remove(one)
            self._matcher.add_image(one[1], one[2], now_s)
        for match in self._matcher.pop_matches(now_s, 0.5):
            self._take(match)

    def _is_due(self, what: str, period_s: float) -> bool:
        is_due = self._now_s >= self._due_s[what]
        if is_due:
            self._due_s[what] += period_s
        return is_due

    def _expose(self, begin_s: float) -> None:
        delay_s = self._rng.uniform(*self._driver.stamp_delay)
        lit = frozenset({self._laser} if self._laser else ())
        exposure = Exposure(self.axis.position_at(begin_s + EXPOSURE_S / 2), lit)
        stamp_ns = int((begin_s + delay_s) * 1e9)
        arrives_s = begin_s + max(delay_s, EXPOSURE_S) + 0.01
        self._images += 1
        repeats = self._driver.repeats
        for _ in range(1 + bool(repeats and self._images % repeats == 0)):
            self._arriving.append((arrives_s, stamp_ns, exposure))

    def _receive_joints(self, message: JointState) -> None:
        state = joint_in_message(message, JOINT)
        assert state is not None
        stamp_ns = nanoseconds(message.header.stamp)
        self.table.add(stamp_ns, *state)
        self._matcher.add_table_position(stamp_ns, *state, now_s=self._now_s)

    def _report_lasers(self) -> None:
        states = {name: float(name == self._laser) for name in NAMES}
        self._matcher.add_laser_states(int(self._now_s * 1e9), states, self._now_s)

    def _take(self, match: FrameMatch) -> None:
        if match.reason:
            self.reasons.append(match.reason)
            return
        exposure: Exposure = match.payload
        frame = Frame(
            image=np.zeros((1, 1), dtype=np.uint8),
            stamp_ns=match.stamp_ns,
            angle=match.angle,
            laser=match.laser,
            view=match.view,
            seq=len(self.profiles),
        )
        self.profiles.append(triangulate(self._cell, frame, self._stripe(exposure)))

    def _stripe(self, exposure: Exposure) -> Stripe:
        lasers = [NAMES.index(name) for name in exposure.lasers]
        found = [self._sphere.stripe(self._cell, exposure.angle, laser) for laser in lasers]
        uv = np.concatenate(found) if found else np.zeros((0, 2))
        ones = np.ones(len(uv))
        return Stripe(uv=uv, intensity=100.0 * ones, width=2.5 * ones, sigma=0.1 * ones)
