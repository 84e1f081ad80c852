# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the triangulator."""

from collections.abc import Callable
from collections.abc import Mapping
from collections.abc import Sequence
from typing import Any

from ivfmc_ros.nodes.framework.parameters import ParameterNode
from ivfmc_ros.storage.frame_matching import MatchSettings
from ivfmc_ros.storage.frame_matching import MOTIONS
from ivfmc_ros.stripe.acquisition import AcquisitionSettings

LASER_SOURCES = ('topic', 'always_on')

# What the core refuses is refused in any case; these are shown to who asks for them.
_RANGES = {
    'extract.min_snr': (3.0, 100.0),
    'extract.min_contrast': (1e-4, 0.9999),
    'extract.max_error': (1e-3, 50.0),
    'extract.window': (1.0, 5.0),
    'extract.max_sigma': (1.0, 50.0),
    'extract.max_widening': (1.001, 50.0),
    'extract.smoothing': (1, 31),
    'extract.along': (0.0, 50.0),
    'volume.radius': (1e-4, 10.0),
    'volume.bottom': (-1.0, 10.0),
    'volume.top': (-1.0, 10.0),
    'noise_distance': (1e-6, 1.0),
    'noise_least': (1, 1000),
}


def declare(node: ParameterNode) -> Callable[[], AcquisitionSettings]:
    """
    Declare the parameters of the triangulator.

    returns : a function that gives the acquisition's settings as they are
    """
    _declare_choice(node)
    _declare_times(node)
    node.check(_refuse)
    # space-time needs pictures that a live scan has not taken yet
    only = ('extract.', 'volume.', 'noise_')
    return node.settings(AcquisitionSettings(), ranges=_RANGES, only=only)


def _declare_choice(node: ParameterNode) -> None:
    node.parameter('scan_id', '', 'Name of the scan; another one begins with profile 0.')
    node.parameter(
        'motion',
        MatchSettings().motion,
        'continuous: every picture with one laser on is a profile. step: only pictures exposed '
        'while the table stood, and one for each view and angle.',
        choices=MOTIONS,
    )
    node.parameter(
        'view',
        [],
        'View number of each laser in the order of cell.yaml, -1 where it is not measured now, as '
        'the orchestrator leaves it after a scan; empty: its own index.',
        kind=int,
    )
    node.parameter(
        'subtract_dark',
        False,
        'Subtract the picture taken with all lasers off at the same stand of the table (step).',
    )
    node.parameter(
        'laser_source',
        'topic',
        'topic: laser_states tells which laser is on. always_on: the only laser of cell.yaml is.',
        choices=LASER_SOURCES,
    )


def _declare_times(node: ParameterNode) -> None:
    default = MatchSettings()
    node.parameter(
        'exposure',
        default.exposure,
        'Seconds; a picture during which a laser changed is not used.',
        low=0.0,
        high=10.0,
    )
    node.parameter(
        'settle',
        default.settle,
        'Seconds that the table must have stood before an exposure (step).',
        low=0.0,
        high=60.0,
    )
    node.parameter(
        'stand',
        default.stand,
        'Radians that a table that stands may seem to move (step).',
        low=0.0,
        high=0.1,
    )
    node.parameter(
        'min_step',
        default.min_step,
        'Radians; less than this from the profile before is the same angle (step).',
        low=0.0,
        high=3.1,
    )
    node.parameter(
        'patience',
        0.5,
        'Seconds that a picture waits for joint_states and laser_states past its exposure; then '
        'it is judged by what is known.',
        low=0.05,
        high=60.0,
    )
    node.parameter('queue', 200, 'Pictures that may wait at most.', low=2, high=10_000)


def match_settings(values: Callable[[str], Any], lasers: Sequence[str]) -> MatchSettings:
    """Return what makes a picture a profile; ``values`` gives a parameter by its name."""
    return MatchSettings(
        motion=values('motion'),
        exposure=values('exposure'),
        always_on=values('laser_source') == 'always_on' and len(lasers) == 1,
        views=tuple(values('view')),
        settle=values('settle'),
        stand=values('stand'),
        min_step=values('min_step'),
        dark=values('subtract_dark'),
    )


def _refuse(values: Mapping[str, Any]) -> None:
    if 'view' in values:
        MatchSettings(views=tuple(values['view'] or ()))
