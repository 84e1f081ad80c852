# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The codes that services, scan_status and commands answer: meaning, and what the caller does."""

from typing import NamedTuple


class Code(NamedTuple):
    """What a code says, and what a cell controller does about it."""

    meaning: str
    action: str


_RETRY = 'Mend the cause that `detail` names, then start the scan again.'
_NODE = 'Check that the node runs (`ivfmc up` prints its output), then start the scan again.'

CODES = {
    'OK': Code('The request is done.', 'Go on.'),
    # requests
    'BUSY': Code(
        'A scan runs (`scan_id` names it), or the node still works on another request.',
        'Wait for the running scan, or call `cancel`.',
    ),
    'WRONG_STATE': Code(
        'The request is not possible at this stage, for example `resume` without a paused scan.',
        'Read `scan_status` and call again when the stage allows it.',
    ),
    'BAD_PARAMETER': Code(
        'A parameter has a value that cannot be used.', 'Set the parameter that `detail` names.'
    ),
    'RESUME_REFUSED': Code(
        'An interrupted scan cannot be resumed: it has ended, is of another calibration, or the '
        'zero of the table is another one; `detail` says which.',
        'Do what `detail` says, or start a new scan.',
    ),
    'CANCELLED': Code('`cancel` was called.', 'Start again when the cell is ready.'),
    'STOPPED': Code(
        '`turntable/stop` ended the motion.', 'Find out who stopped it before you start again.'
    ),
    # files
    'BAD_FILE': Code('A file cannot be read or written.', _RETRY),
    'BAD_CELL': Code(
        '`cell.yaml` is damaged or does not fit the camera.',
        'Correct the file or calibrate again.',
    ),
    'BAD_RECIPE': Code(
        'There is no recipe of this name in `recipe_root`, or it is not valid.',
        'Correct the file or the name; `ivfmc recipes` checks all recipes of a cell.',
    ),
    'NOT_CHECKED': Code(
        'The last acceptance test of the cell is missing, too old, failed or of another '
        'calibration, and `check_policy` is `refuse`.',
        'Run `ivfmc calibrate check` with a calibrated artifact, then start the scan again.',
    ),
    'BAD_BAG': Code(
        'A bag is damaged or lacks a topic.', 'Use another bag, or map its topics with `--role`.'
    ),
    'BAD_CATALOGUE': Code(
        '`catalogue.sqlite3` cannot be read or written, or does not know the scan.',
        'Check the folder `scan_root` and the scan id.',
    ),
    'BAD_MESSAGE': Code(
        'A message lacks a field, or its data do not match what it declares.',
        'Correct the publisher of the topic that `detail` names.',
    ),
    'NOT_READY': Code(
        'The node has no `cell.yaml`, no `camera_info`, or no views yet.',
        'Give it what `detail` names, then call again.',
    ),
    # what was measured
    'NO_STRIPE': Code(
        'No picture shows the stripe in the working volume.',
        'Check laser, exposure and working volume.',
    ),
    'NO_PROFILE': Code(
        'No profile came, and nothing towards it within `profile_patience`.', _NODE
    ),
    'PROFILES_LOST': Code(
        'The registrar did not receive all profiles.',
        '`ivfmc reconstruct SCAN_ID` makes the mesh from the bag.',
    ),
    'NOT_RECORDED': Code(
        'The recorder did not write all profiles to the disk.',
        'Free space or a faster disk; `detail` has the reason of the recorder.',
    ),
    'DISK_FULL': Code(
        'The disk of `scan_root` has too little free space: the scan was refused, or ended in '
        'good order with what was taken.',
        'Free space (`ivfmc scans delete` and `empty-trash`), then scan again.',
    ),
    'INCOMPLETE': Code(
        'Profiles or angles that the plan asked for are missing; `completeness` has the angles of '
        'each view. What was taken is kept and meshed.',
        'Check camera and load of the computer, then scan again.',
    ),
    'CLOCK_JUMPED': Code(
        'A clock that stamps images or joint states was set during the scan.',
        'Let NTP slew the clocks, or set them before a scan; then scan again.',
    ),
    'SLIPPED': Code(
        'The table or the part slipped: surfaces that were measured twice differ by a rotation, '
        'or the triggers of the camera and the reported positions disagree. '
        '`registration.table` has the size and the table angles. What was taken is kept and '
        'meshed, with a wrong shape.',
        'Check motor current, acceleration, coupling and clamping, then scan again.',
    ),
    'TRIGGER_REFUSED': Code(
        'The pictures of a camera that the table triggers cannot be numbered by its steps: wrong '
        '`trigger_step`, a camera that is not triggered, or reports that are too irregular. '
        '`registration.motions` has the reason of each view. What was taken is kept and meshed, '
        'with the angles of the reported positions.',
        'Check the trigger line, `trigger_step` of cell.yaml and `trigger` of the camera, then '
        'scan again.',
    ),
    'NOT_CONVERGED': Code(
        'The registration found no poses at which the views agree; `registration.verdicts` has '
        'the reason for each view. Or the light sheet of a laser moved while the scan was taken; '
        '`registration.table.drift` has by how much.',
        'Check that the part stands firmly and that the calibration is valid, let laser and '
        'camera warm up (`warm_up`), then scan again.',
    ),
    'DEGENERATE': Code(
        'The points do not determine the surface, pose or shape.',
        'Scan with finer steps or more views.',
    ),
    'AMBIGUOUS': Code(
        'Clampings fit each other in several ways; `poses` or `motions` lists them.',
        'Add a scan that shows a distinguishing feature.',
    ),
    'CALIBRATION_REFUSED': Code(
        'The pictures do not determine the calibration well enough.',
        'Take more pictures as `detail` says.',
    ),
    # devices and nodes
    'MOTION_FAILED': Code(
        'The table was not at the commanded position before the deadline.',
        'Check the axis and `turntable` in /diagnostics.',
    ),
    'LASER_FAILED': Code('The laser did not report the commanded state in time.', _NODE),
    'LASER_STUCK': Code(
        'A laser is reported off and still shines in the images.',
        'Cut its supply at once; it is a hazard until relay and wiring are repaired.',
    ),
    'DEVICE': Code('A device does not do what it was commanded.', _RETRY),
    'HELPER': Code('A node answered that it could not do its work.', _RETRY),
    'CAMERA_LOST': Code(
        'The camera gives no pictures, or always the same one, or its node is silent.', _NODE
    ),
    'TURNTABLE_LOST': Code('The node of the motion controller is silent.', _NODE),
    'JOINT_STATES_LOST': Code('`joint_states` no longer reports the table.', _NODE),
    'TRIANGULATOR_LOST': Code('The triangulator is silent.', _NODE),
    'REGISTRAR_LOST': Code('The registrar is silent.', _NODE),
    'MESHER_LOST': Code('The mesher is silent.', _NODE),
    'RECORDER_LOST': Code('The recorder is silent.', _NODE),
    'CONTROLLER_LOST': Code(
        'The motion controller has no port, is silent or was unplugged.',
        'Connect it, then call `turntable/clear_alarm`.',
    ),
    'CONTROLLER_ALARM': Code(
        'The motion controller is locked; `detail` names its alarm.',
        'Call `turntable/home` or `turntable/clear_alarm`.',
    ),
    'JOINT_CONTRADICTORY': Code(
        'Positions of the table contradict each other or are faster than any table; as a rule two '
        'nodes publish its joint. `detail` names the publishers.',
        'Stop or rename the joint of one of them, then start the scan again.',
    ),
    'POSITION_LOST': Code(
        'The motion controller restarted, or the table is not where its motion should have taken '
        'it, by its reports or by the index mark.',
        'Call `turntable/home` or `turntable/clear_alarm`, then scan again.',
    ),
    'CONTROLLER_REFUSED': Code(
        'The motion controller understood a command and refused it, for example homing that is '
        'not enabled.',
        'Change its settings or the command.',
    ),
    'INTERRUPTED': Code(
        'The orchestrator ended while the scan ran; its folder keeps what was taken.',
        'Set `resume_scan` to its id and call `resume` (`ivfmc scan --resume SCAN_ID`), or start '
        'the scan again.',
    ),
    'TIMEOUT': Code('Something did not happen before its deadline.', _RETRY),
    'INTERNAL': Code('An error of this software.', 'Report it with the log of the node.'),
    # of the command ivfmc only
    'ORCHESTRATOR_LOST': Code(
        'The orchestrator is silent; `ivfmc scan` does not wait for it.',
        'Start the cell again: the scan is marked as interrupted, and can be resumed.',
    ),
    'NODE_DIED': Code('A process of `ivfmc up` or `ivfmc demo` ended.', _NODE),
    'NOT_STARTED': Code('A process did not come up.', _NODE),
    'NO_ROS': Code(
        'No ROS 2 is installed for this command.', 'Source a workspace, or `make env`.'
    ),
}
