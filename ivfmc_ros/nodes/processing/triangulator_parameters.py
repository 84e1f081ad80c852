# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the triangulator and the settings that they make."""

from collections.abc import Callable
from collections.abc import Mapping
from collections.abc import Sequence
from typing import Any

from ivfmc_ros.nodes.framework.parameters import ParameterNode
from ivfmc_ros.storage.matching.frame_matching import MatchSettings
from ivfmc_ros.storage.matching.frame_matching import MAX_EXPOSURES
from ivfmc_ros.storage.matching.frame_matching import MOTIONS
from ivfmc_ros.stripe.acquisition import AcquisitionSettings

LASER_SOURCES = ('topic', 'always_on')

# Ranges of the parameter descriptors; the settings classes of the core check their values anyway.
_RANGES = {
    'extract.min_snr': (3.0, 100.0),
    'extract.min_contrast': (1e-4, 0.9999),
    'extract.max_error': (1e-3, 50.0),
    'extract.window': (1.0, 5.0),
    'extract.max_sigma': (1.0, 50.0),
    'extract.max_widening': (1.001, 50.0),
    'extract.smoothing': (1, 31),
    'extract.along': (0.0, 50.0),
    'extract.image_bits': (0, 16),
    'volume.radius': (1e-4, 10.0),
    'volume.bottom': (-1.0, 10.0),
    'volume.top': (-1.0, 10.0),
    'noise_distance': (1e-6, 1.0),
    'noise_least': (1, 1000),
}


def declare(node: ParameterNode) -> Callable[[], AcquisitionSettings]:
    """
    Declare the parameters of the triangulator.

    returns : a function that builds the acquisition settings from the current values
    """
    _declare_matching(node)
    _declare_timing(node)
    node.check(_require_matching)
    # no space_time.*: it needs images that a live scan has not taken yet
    only = ('extract.', 'volume.', 'noise_')
    return node.settings(AcquisitionSettings(), ranges=_RANGES, only=only)


def _declare_matching(node: ParameterNode) -> None:
    node.parameter(
        'scan_id', '', 'Id of the scan; a new one restarts the profile numbers at first_profile.'
    )
    node.parameter(
        'first_profile',
        0,
        'Number of the first profile of the scan, set before scan_id: the number of profiles that '
        'an interrupted scan has.',
        low=0,
        high=10_000_000,
    )
    node.parameter(
        'motion',
        MatchSettings().motion,
        'continuous: every image with exactly one laser on becomes a profile. step: only images '
        'exposed while the table stood still, one for each view and angle.',
        choices=MOTIONS,
    )
    node.parameter(
        'view',
        [],
        'View number of each laser in the order of cell.yaml, -1 for a laser that is not measured '
        '(set by the orchestrator between scans); empty: the index of the laser.',
        kind=int,
    )
    node.parameter(
        'subtract_dark',
        False,
        'Subtract the image taken with all lasers off at the same table angle (step).',
    )
    node.parameter(
        'exposures',
        MatchSettings().exposures,
        'Number of images of one view at the same table angle that make one profile, taken with '
        'different exposure times while the table stands still; not with subtract_dark.',
        low=1,
        high=MAX_EXPOSURES,
    )
    node.parameter(
        'laser_source',
        'topic',
        'topic: laser_states reports which laser is on. always_on: the only laser of the cell is.',
        choices=LASER_SOURCES,
    )


def _declare_timing(node: ParameterNode) -> None:
    default = MatchSettings()
    node.parameter(
        'exposure',
        default.exposure,
        'Exposure time, seconds; an image during which a laser was switched is not used.',
        low=0.0,
        high=10.0,
    )
    node.parameter(
        'stamp_delay',
        default.stamp_delay,
        'Seconds by which the stamp of an image is later than the start of its exposure, at most '
        '(drivers that stamp the arrival): neither lasers nor table (step) may have changed since.'
        ' Not with subtract_dark.',
        low=0.0,
        high=10.0,
    )
    node.parameter(
        'settle',
        default.settle,
        'Seconds that the table must have stood still before an exposure (step).',
        low=0.0,
        high=60.0,
    )
    node.parameter(
        'stand',
        default.stand,
        'Reported motion of a table that stands still, radians (step).',
        low=0.0,
        high=0.1,
    )
    node.parameter(
        'min_step',
        default.min_step,
        'Angle differences below this, radians, count as the same table position (step).',
        low=0.0,
        high=3.1,
    )
    node.parameter(
        'patience',
        0.5,
        'Seconds that an image waits for joint_states and laser_states past its exposure; then '
        'it is matched with the states received so far.',
        low=0.05,
        high=60.0,
    )
    node.parameter(
        'queue',
        200,
        'Maximum number of images that wait for joint_states and laser_states.',
        low=2,
        high=10_000,
    )


def match_settings(values: Callable[[str], Any], lasers: Sequence[str]) -> MatchSettings:
    """Return the settings of the matcher; ``values`` returns a parameter by name."""
    return MatchSettings(
        motion=values('motion'),
        exposure=values('exposure'),
        stamp_delay=values('stamp_delay'),
        always_on=values('laser_source') == 'always_on' and len(lasers) == 1,
        views=tuple(values('view')),
        settle=values('settle'),
        stand=values('stand'),
        min_step=values('min_step'),
        dark=values('subtract_dark'),
        exposures=values('exposures'),
    )


def _require_matching(values: Mapping[str, Any]) -> None:
    if 'view' in values:
        MatchSettings(views=tuple(values['view'] or ()))
    if 'exposures' in values and 'subtract_dark' in values:
        MatchSettings(exposures=values['exposures'], dark=values['subtract_dark'])
    if 'stamp_delay' in values and 'subtract_dark' in values:
        MatchSettings(stamp_delay=values['stamp_delay'], dark=values['subtract_dark'])
