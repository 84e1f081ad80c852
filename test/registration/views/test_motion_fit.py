# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from support.sweep import delayed_positions
from support.sweep import SECOND
from support.sweep import START
from support.sweep import TrapezoidalMotion
from support.synthetic import make_profile

from ivfmc_ros.registration.views.motion_fit import refit
from ivfmc_ros.storage.matching.frame_matching import FrameMatcher
from ivfmc_ros.storage.matching.frame_matching import MatchSettings


def profiles_of(turn, *, rate=10.0, shots=None, seed=0, view=0):
    """Profiles with the angles that reports give; the point is at x = 50 mm in the base."""
    shots = np.arange(0.0, 19.0, 1 / 30) if shots is None else shots
    matcher = FrameMatcher(['left'], MatchSettings(always_on=True))
    for stamp, position in delayed_positions(turn, rate, 21.0, seed):
        matcher.add_table_position(stamp, position)
    for shot in shots:
        matcher.add_image(START + round(shot * SECOND), shot)
    found = []
    for seq, match in enumerate(matcher.pop_matches()):
        c, s = np.cos(match.angle), np.sin(match.angle)
        profile = make_profile(
            [[0.05 * c, -0.05 * s, 0.01]], angle=match.angle, seq=seq, view=view
        )
        changes = {'stamp_ns': match.stamp_ns, 'speed': match.speed}
        found.append(type(profile)(**{**vars(profile), **changes}))
    return found


def errors(turn, profiles):
    """Radians off the truth, without the constant that turns the whole part."""
    seconds = np.array([(profile.stamp_ns - START) / SECOND for profile in profiles])
    off = np.array([profile.angle for profile in profiles]) - turn.position_at(seconds)
    return off - off.mean(), seconds


@pytest.mark.parametrize('rate', [5.0, 10.0, 100.0])
@pytest.mark.parametrize('seed', [0, 1, 2])
def test_fitted_angles_are_four_times_as_accurate_as_the_reports(rate, seed):
    turn = TrapezoidalMotion()
    measured = profiles_of(turn, rate=rate, seed=seed)
    found, (motion,) = refit(measured)
    off, seconds = errors(turn, found)
    used = {profile.seq for profile in found}
    raw, _ = errors(turn, [profile for profile in measured if profile.seq in used])
    assert np.sqrt(np.mean(off**2)) < np.radians(0.025)
    assert np.sqrt(np.mean(off**2)) < 0.25 * np.sqrt(np.mean(raw**2))
    assert motion.speed == pytest.approx(turn.speed, rel=1e-3)
    assert 0.002 < motion.jitter < 0.006
    # nothing of the ramps, and not much less than all between them
    begin, end = turn.constant_speed
    assert begin <= seconds[0] < begin + 0.4
    assert end - 0.4 < seconds[-1] <= end
    assert motion.dropped == len(measured) - len(found)


def test_points_turn_with_their_angle():
    found, _ = refit(profiles_of(TrapezoidalMotion()))
    for profile in found:
        c, s = np.cos(profile.angle), np.sin(profile.angle)
        np.testing.assert_allclose(profile.points_xyz, [[0.05 * c, -0.05 * s, 0.01]], atol=1e-12)


def test_a_sweep_without_ramps_loses_nothing():
    shots = np.arange(3.0, 15.0, 1 / 30)
    found, (motion,) = refit(profiles_of(TrapezoidalMotion(), shots=shots))
    assert (len(found), motion.dropped) == (len(shots), 0)


@pytest.mark.parametrize('seed', [0, 1, 2])
def test_sweep_without_images_for_seconds_is_fitted_by_one_line(seed):
    # the mean delays of two lines differ: their ends were turned by 0.15 degrees, which is a slip
    turn = TrapezoidalMotion()
    begin, end = turn.constant_speed
    middle = 0.5 * (begin + end)
    shots = np.arange(0.0, 19.0, 1 / 30)
    shots = shots[(shots < middle - 2.5) | (shots > middle + 2.5)]
    found, _ = refit(profiles_of(turn, rate=10.0, shots=shots, seed=seed))
    off, seconds = errors(turn, found)
    late = seconds > middle
    assert abs(off[late].mean() - off[~late].mean()) < np.radians(0.03)


def test_two_sweeps_of_one_view_number_are_fitted_separately():
    first = profiles_of(TrapezoidalMotion(cruise=5.0), shots=np.arange(2.0, 5.0, 1 / 30))
    second = profiles_of(TrapezoidalMotion(cruise=5.0), shots=np.arange(2.0, 5.0, 1 / 30), seed=1)
    later = [
        type(p)(**{**vars(p), 'stamp_ns': p.stamp_ns + 60 * SECOND, 'seq': p.seq + len(first)})
        for p in second
    ]
    found, (motion,) = refit([*first, *later])
    assert motion.used == len(first) + len(later)
    alone = refit(first)[0] + refit(later)[0]
    np.testing.assert_allclose([p.angle for p in found], [p.angle for p in alone], atol=1e-12)


def test_stepped_scan_is_unchanged():
    profiles = [
        make_profile([[0.05, 0.0, 0.01]], angle=0.1 * step, seq=step) for step in range(60)
    ]
    found, (motion,) = refit(profiles)
    assert found == profiles
    assert motion.speed == 0.0


def test_reported_angles_are_kept_without_a_constant_speed_and_the_reason_is_given():
    def swing(seconds):
        return 0.5 * np.sin(3.0 * seconds) + 1.2 * seconds

    profiles = []
    for seq, shot in enumerate(np.arange(0.0, 6.0, 1 / 30)):
        profile = make_profile([[0.05, 0.0, 0.01]], angle=float(swing(shot)), seq=seq)
        changes = {'stamp_ns': round(shot * SECOND), 'speed': 1.0}
        profiles.append(type(profile)(**{**vars(profile), **changes}))
    found, (motion,) = refit(profiles)
    assert found == profiles
    assert 'not at a constant speed' in motion.why


def test_no_profiles_have_no_motion():
    assert refit([]) == ([], [])


@pytest.mark.parametrize('seconds', [0.3, 1.2, 1.9])
def test_view_that_was_interrupted_in_its_lead_in_is_left_out(seconds):
    turn = TrapezoidalMotion()
    whole = profiles_of(turn)
    short = profiles_of(turn, shots=np.arange(0.0, seconds, 1 / 10), view=1)
    found, motions = refit([*whole, *short])
    assert {profile.view for profile in found} == {0}
    assert (motions[1].used, motions[1].dropped) == (0, len(short))
    assert 'left out' in motions[1].why
    # alone it is kept: nothing says that it is part of a scan in motion
    assert len(refit(short)[0]) == len(short)
