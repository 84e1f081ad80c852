# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
URDF of a cell for robot_state_publisher, generated from ``cell.yaml``.

TF thus has the same calibration as the scanner; the file is not to be edited.
"""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ivfmc_ros import files
from ivfmc_ros.cell import transforms
from ivfmc_ros.cell.cell_file import CellDraft
from ivfmc_ros.errors import CellError
from ivfmc_ros.model import Floats

BASE = 'turntable_base'
TABLE = 'turntable'

# Shapes for display only: radius and height of the platter, edges of the camera, meters.
_PLATTER = ('0.09', '0.006')
_HOUSING = '0.03 0.03 0.05'


def urdf(draft: CellDraft) -> str:
    """
    Return the URDF of a cell: base -> camera (fixed), base -> table (turns about z).

    :raises CellError: the cell has no turntable
    """
    if draft.turntable is None:
        raise CellError('cell.yaml: turntable: is missing, so there is no URDF')
    robot = ElementTree.Element('robot', name='ivfmc_cell')
    ElementTree.SubElement(robot, 'link', name=BASE)
    table = ElementTree.SubElement(robot, 'link', name=TABLE)
    _platter(table)
    camera = ElementTree.SubElement(robot, 'link', name=draft.camera_frame)
    _box(camera)
    fixed = _joint(robot, 'camera_joint', 'fixed', draft.camera_frame)
    _origin(fixed, transforms.invert(draft.turntable.camera_from_base))
    turning = _joint(robot, draft.turntable.joint, 'continuous', TABLE)
    ElementTree.SubElement(turning, 'axis', xyz='0 0 1')
    ElementTree.indent(robot)
    text = ElementTree.tostring(robot, encoding='unicode')
    return f'<?xml version="1.0"?>\n<!-- generated from cell.yaml; edit that file -->\n{text}\n'


def write_urdf(path: Path, draft: CellDraft) -> None:
    """
    Write the URDF of a cell, whole or not at all.

    :raises CellError: the cell has no turntable
    :raises FileError: the file cannot be written
    """
    files.write_text(path, urdf(draft))


def roll_pitch_yaw(R: Floats) -> Floats:
    """Return (3,) radians about the fixed axes x, y, z, in that order, of a (3, 3) rotation."""
    pitch = np.arcsin(np.clip(-R[2, 0], -1.0, 1.0))
    if abs(R[2, 0]) > 1.0 - 1e-12:
        # gimbal lock: roll and yaw have the same axis, yaw is set to 0
        return np.array([np.arctan2(-R[1, 2], R[1, 1]), pitch, 0.0])
    return np.array([np.arctan2(R[2, 1], R[2, 2]), pitch, np.arctan2(R[1, 0], R[0, 0])])


def _joint(robot: ElementTree.Element, name: str, kind: str, child: str) -> ElementTree.Element:
    joint = ElementTree.SubElement(robot, 'joint', name=name, type=kind)
    ElementTree.SubElement(joint, 'parent', link=BASE)
    ElementTree.SubElement(joint, 'child', link=child)
    return joint


def _origin(element: ElementTree.Element, T: Floats) -> None:
    xyz, rpy = (
        ' '.join(f'{value:.9g}' for value in values)
        for values in (T[:3, 3], roll_pitch_yaw(T[:3, :3]))
    )
    ElementTree.SubElement(element, 'origin', xyz=xyz, rpy=rpy)


def _platter(link: ElementTree.Element) -> None:
    radius, height = _PLATTER
    visual = ElementTree.SubElement(link, 'visual')
    # the part stands on its upper face
    ElementTree.SubElement(visual, 'origin', xyz=f'0 0 -{float(height) / 2}', rpy='0 0 0')
    geometry = ElementTree.SubElement(visual, 'geometry')
    ElementTree.SubElement(geometry, 'cylinder', radius=radius, length=height)


def _box(link: ElementTree.Element) -> None:
    visual = ElementTree.SubElement(link, 'visual')
    geometry = ElementTree.SubElement(visual, 'geometry')
    ElementTree.SubElement(geometry, 'box', size=_HOUSING)
