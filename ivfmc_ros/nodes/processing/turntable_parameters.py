# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the turntable node and the settings that they make."""

from collections.abc import Callable
from collections.abc import Sequence
from pathlib import Path
import re

from ivfmc_ros.devices.beam import BeamSettings
from ivfmc_ros.devices.motion.axis_units import AUTO_AXIS
from ivfmc_ros.devices.settings import ControllerSettings
from ivfmc_ros.devices.settings import FIRMWARES
from ivfmc_ros.devices.settings import INDEX_PINS
from ivfmc_ros.devices.settings import OUTPUTS
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.nodes.framework.parameters import ParameterNode

_NO_INDEX = 'none'  # value of index_pin
# Names of lasers are part of the service name <laser>/enable.
_NAME = re.compile(r'[A-Za-z][A-Za-z0-9_]*')


def declare(
    node: ParameterNode,
) -> tuple[Callable[[], ControllerSettings], Callable[[], BeamSettings]]:
    """
    Declare the parameters of the turntable.

    returns : functions that build the settings of controller and beam from the current values
    :raises ParameterError: the values at the start fit no controller
    """
    _declare_connection(node)
    _declare_axis(node)
    _declare_lasers(node)
    _declare_beam(node)
    _controller_settings(node)
    _beam_settings(node)
    return lambda: _controller_settings(node), lambda: _beam_settings(node)


def _declare_connection(node: ParameterNode) -> None:
    port = 'Serial port of the controller, or a pyserial URL.'
    node.parameter('port', '', port, read_only=True)
    node.parameter(
        'baud',
        115200,
        'Baud rate of the serial port; FabScan has 57600.',
        low=1200,
        high=4_000_000,
        read_only=True,
    )
    node.parameter(
        'controller',
        FIRMWARES[0],
        'Firmware of the controller; auto: found out by what the controller says.',
        choices=FIRMWARES,
        read_only=True,
    )
    node.parameter(
        'reconnect',
        True,
        'Connect again when a lost controller comes back; the table does not move and no laser '
        'lights by that, and the position is unknown (homed is false) until it is homed or '
        'clear_alarm accepts it. false: clear_alarm connects.',
    )


def _declare_axis(node: ParameterNode) -> None:
    node.parameter(
        'axis',
        AUTO_AXIS,
        'Axis letter of the table; auto: the first of A, B, C that there is, else X.',
        choices=(AUTO_AXIS, *'XYZABC'),
        read_only=True,
    )
    node.parameter(
        'units_per_turn',
        360.0,
        'Controller units (FabScan: steps) per turn; negative if positive is clockwise seen from '
        'above.',
        low=-1e6,
        high=1e6,
        read_only=True,
    )
    node.parameter(
        'index_pin',
        _NO_INDEX,
        'Input of the controller (GRBL 1.1, grblHAL, FluidNC) that a switch on the table makes '
        'active once a turn: where it changes is compared with former turns. Limit switches X, Y, '
        'Z, probe P; none: no such switch.',
        choices=(_NO_INDEX, *INDEX_PINS),
        read_only=True,
    )
    table = 'The controller has a table; false: lasers only.'
    node.parameter('table', True, table, read_only=True)
    joint = 'Joint name in joint_states and joint_trajectory.'
    node.parameter('joint', 'turntable_joint', joint, read_only=True)
    rate = 'Rate of joint_states, Hz.'
    node.parameter('joint_rate', 60.0, rate, low=1.0, high=500.0, read_only=True)
    velocity = 'Maximum velocity of the table, rad/s.'
    node.parameter('velocity', 2.0, velocity, low=0.001, high=100.0)


def _declare_lasers(node: ParameterNode) -> None:
    node.parameter('lasers', ['left', 'right'], 'Names of the lasers, as in cell.yaml.')
    node.parameter(
        'laser_outputs',
        ['spindle', 'coolant'],
        'Output of each laser. GRBL: spindle (M3, M5), coolant (M8, M9); Marlin: fan0 to fan3 '
        '(M106, M107), spindle; Horus: laser1 to laser4 (M71, M70); FabScan: laser1, laser2.',
    )
    node.parameter(
        'laser_power',
        1.0,
        'Power of a laser on an output that can be dimmed (spindle, fan), 0 to 1.',
        low=0.0,
        high=1.0,
    )


def _declare_beam(node: ParameterNode) -> None:
    node.parameter(
        'beam_hold_timeout',
        0.5,
        'Seconds without beam_hold until the lasers go off.',
        low=0.1,
        high=5.0,
    )
    limit = 'Seconds that a laser stays on by its service.'
    node.parameter('beam_limit', 10.0, limit, low=0.0, high=600.0)
    node.parameter(
        'beam_permit_required',
        False,
        'Lasers stay off until beam_permit is true.',
        read_only=True,
    )
    node.parameter(
        'beam_permit_timeout',
        0.0,
        'Seconds that a beam_permit stays valid; 0: until it is false.',
        low=0.0,
        high=600.0,
    )


def _controller_settings(node: ParameterNode) -> ControllerSettings:
    lasers = [name for name in node.get('lasers') if name]
    outputs = [name for name in node.get('laser_outputs') if name]
    _require_names(lasers)
    if len(outputs) != len(lasers):
        raise ParameterError(
            f'laser_outputs: {len(outputs)} for {len(lasers)} lasers; each laser needs one of '
            f'{", ".join(OUTPUTS)}'
        )
    return ControllerSettings(
        port=_port(node.get('port')),
        baud=node.get('baud'),
        firmware=node.get('controller'),
        axis=node.get('axis'),
        units_per_turn=node.get('units_per_turn'),
        lasers=dict(zip(lasers, outputs, strict=True)),
        power=node.get('laser_power'),
        index_pin='' if node.get('index_pin') == _NO_INDEX else node.get('index_pin'),
    )


def _beam_settings(node: ParameterNode) -> BeamSettings:
    return BeamSettings(
        hold_timeout=node.get('beam_hold_timeout'),
        limit=node.get('beam_limit'),
        permit_required=node.get('beam_permit_required'),
        permit_timeout=node.get('beam_permit_timeout'),
    )


def _port(text: str) -> str:
    # Path would drop one of the slashes of a URL
    return text if not text or '://' in text else str(Path(text).expanduser())


def _require_names(lasers: Sequence[str]) -> None:
    wrong = [name for name in lasers if not _NAME.fullmatch(name)]
    if wrong:
        raise ParameterError(
            f'lasers: {wrong[0]!r} cannot be part of a service name; use letters, digits and _ '
            '(the first a letter), here and in cell.yaml'
        )
    if len(set(lasers)) != len(lasers):
        raise ParameterError(f'lasers: a name occurs twice ({", ".join(lasers)})')
