# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the joint adjustment: their order in a vector, and the state they change."""

from dataclasses import dataclass
from dataclasses import replace

import numpy as np

from ivfmc_ros.calibration.boards.board_shape import BoardShape
from ivfmc_ros.calibration.turntable.axis import AxisState
from ivfmc_ros.calibration.turntable.axis_adjustment import apply_axis_step
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.covariance import INTRINSIC_NAMES
from ivfmc_ros.cell.laser import Bow
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats

# Parameters of a laser: two tilts of the plane, its offset, three coefficients of its bow.
LASER_SIZE = 6
_SHAPE_SIZE = 4  # of the board: bend a, b, c and the stretch
# Parameters of the axis before the layout: 5 of the base, 2 of the platter, scale, bloom.
_AXIS_SIZE = 9


@dataclass(frozen=True, eq=False, kw_only=True)
class JointState:
    """
    All that the adjustment estimates.

    board_shape : of the board that is held by hand
    axis : turntable, layout of the target on it, table angle of every picture of it
    board_poses : (views, 6) rotation vector and translation in meters, board to camera
    """

    camera: Camera
    board_shape: BoardShape
    lasers: tuple[LaserPlane, ...]
    axis: AxisState
    board_poses: Floats

    @property
    def intrinsics(self) -> Floats:
        """(4 + distortion,) fx, fy, cx, cy, distortion."""
        K = self.camera.K
        return np.array([*K[[0, 1, 0, 1], [0, 1, 2, 2]], *self.camera.distortion])


@dataclass(frozen=True)
class ParameterOrder:
    """
    Places of the common parameters in their vector: all but board poses and table angles.

    intrinsic_count : 4 + distortion coefficients
    laser_names : of the lasers
    layout_count : rows of ``AxisState.layout``
    """

    intrinsic_count: int
    laser_names: tuple[str, ...]
    layout_count: int

    @classmethod
    def of(cls, state: JointState) -> 'ParameterOrder':
        """Return the order of the parameters of a state."""
        names = tuple(laser.name for laser in state.lasers)
        return cls(len(state.intrinsics), names, len(state.axis.layout))

    @property
    def intrinsics(self) -> slice:
        """Intrinsics of the camera."""
        return slice(0, self.intrinsic_count)

    @property
    def shape(self) -> slice:
        """Shape of the board."""
        return slice(self.intrinsic_count, self.intrinsic_count + _SHAPE_SIZE)

    def laser(self, index: int) -> slice:
        """Plane and bow of a laser."""
        first = self.shape.stop + LASER_SIZE * index
        return slice(first, first + LASER_SIZE)

    @property
    def axis(self) -> slice:
        """Axis, platter, scale, bloom and layout, as ``axis_adjustment`` orders them."""
        first = self.shape.stop + LASER_SIZE * len(self.laser_names)
        return slice(first, first + _AXIS_SIZE + 3 * self.layout_count)

    @property
    def count(self) -> int:
        """Number of common parameters."""
        return int(self.axis.stop)

    def names(self) -> tuple[str, ...]:
        """Return (count,) names, for reports."""
        intrinsics = INTRINSIC_NAMES[: self.intrinsic_count]
        lasers = [
            f'{laser}: {part}'
            for laser in self.laser_names
            for part in ('tilt 1', 'tilt 2', 'offset', 'bow 1', 'bow 2', 'bow 3')
        ]
        axis = ('axis: tilt x', 'axis: tilt y', 'axis: x', 'axis: y', 'axis: height')
        platter = ('platter: tilt x', 'platter: tilt y', 'platter target: scale', 'bloom')
        layout = [f'layout {row} {part}' for row in range(self.layout_count) for part in '123']
        shape = ('board: bend 1', 'board: bend 2', 'board: bend 3', 'board: stretch')
        return (*intrinsics, *shape, *lasers, *axis, *platter, *layout)


@dataclass(frozen=True, kw_only=True)
class FreeJointParameters:
    """
    Parameters that the adjustment estimates besides poses and angles.

    square : keep fx = fy and estimate the stretch of the board
    fixed : indices of intrinsics that stay as they are
    bend : the bend of the board
    free_corners : corners of single markers are points of their own
    """

    square: bool
    fixed: tuple[int, ...]
    bend: bool
    free_corners: bool

    def expansion(self, order: ParameterOrder, state: JointState) -> Floats:
        """Return (count, free): matrix from the free to all common parameters."""
        matrix, keep = np.eye(order.count), np.ones(order.count, dtype=bool)
        if self.square:
            matrix[1, 0], keep[1] = 1.0, False
        keep[list(self.fixed)] = False
        keep[order.shape] = [self.bend] * 3 + [self.square]
        for index, laser in enumerate(state.lasers):
            keep[order.laser(index)][3:] = laser.bow is not None
        keep[order.axis] = self._free_axis(order)
        return matrix[:, keep]

    def _free_axis(self, order: ParameterOrder) -> Bools:
        keep = np.ones(_AXIS_SIZE + 3 * order.layout_count, dtype=bool)
        keep[7], keep[8] = not self.free_corners, self.free_corners
        if not self.free_corners:
            # the yaw of the layout and the table angles are one: the first target stays
            keep[_AXIS_SIZE + 2] = False
        return keep


def vague_sigma(order: ParameterOrder) -> Floats:
    """
    Return (count,) standard deviations of what any cell of this kind has, before any picture.

    Focal lengths and principal points differ by hundreds of pixels, distortion by units, lengths
    of a cell by decimeters, directions by 20 degrees.
    """
    sigma = np.full(order.count, 0.3)  # meters: layout of the target on the platter
    sigma[order.intrinsics] = [500.0, 500.0, 200.0, 200.0, *[1.0] * (order.intrinsic_count - 4)]
    sigma[order.shape] = [1.0, 1.0, 1.0, 0.01]  # 1/meter, and the stretch of the print
    for index in range(len(order.laser_names)):
        sigma[order.laser(index)] = [0.3, 0.3, 0.1, 1.0, 1.0, 1.0]  # radians, meters, 1/meter
    first = order.axis.start
    sigma[first : first + _AXIS_SIZE] = [0.3, 0.3, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 5.0]
    return sigma


def apply_step(
    state: JointState, order: ParameterOrder, common: Floats, poses: Floats, angles: Floats
) -> JointState:
    """
    Return the state after a step.

    common : (count,); poses : (views, 6); angles : (pictures,) radians
    """
    shape = state.board_shape
    return JointState(
        camera=_moved_camera(state, common[order.intrinsics]),
        board_shape=replace(shape, coefficients=shape.coefficients + common[order.shape]),
        lasers=tuple(
            moved_laser(laser, common[order.laser(index)])
            for index, laser in enumerate(state.lasers)
        ),
        axis=apply_axis_step(state.axis, common[order.axis], angles),
        board_poses=state.board_poses + poses,
    )


def _moved_camera(state: JointState, step: Floats) -> Camera:
    fx, fy, cx, cy, *distortion = state.intrinsics + step
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return replace(state.camera, K=K, distortion=np.array(distortion), covariance=None)


def plane_tangent(normal: Floats) -> Floats:
    """Return (3, 2): two unit vectors in the plane of a normal, the directions of its tilts."""
    return np.asarray(np.linalg.svd(normal[None])[2][1:].T)


def moved_laser(laser: LaserPlane, step: Floats) -> LaserPlane:
    """Return a laser after a step (6,) of tilts (radians), offset (meters) and bow (1/meter)."""
    normal = laser.normal + plane_tangent(laser.normal) @ step[:2]
    length = float(np.linalg.norm(normal))
    normal, offset = normal / length, (laser.offset + float(step[2])) / length
    return replace(
        laser, normal=normal, offset=offset, bow=_moved_bow(laser.bow, step, normal, offset)
    )


def _moved_bow(bow: Bow | None, step: Floats, normal: Floats, offset: float) -> Bow | None:
    if bow is None:
        return None
    along = bow.along - (bow.along @ normal) * normal
    return Bow(
        center=bow.center - (bow.center @ normal + offset) * normal,
        along=along / np.linalg.norm(along),
        coefficients=bow.coefficients + step[3:],
    )
