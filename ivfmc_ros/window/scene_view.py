# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The 3-D view: profiles as they come, the registered cloud, the mesh, and the cell around them.

Objects are drawn in centimeters in the frame ``turntable``, so that near and far planes of the
browser's camera fit; the cell turns about the part. A browser gets a bounded number of points,
however long a scan is.
"""

from collections.abc import Callable
from dataclasses import dataclass
from dataclasses import field
import math
import threading
from typing import Any

import numpy as np

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import Profile
from ivfmc_ros.window import cell_drawing
from ivfmc_ros.window import coloring
from ivfmc_ros.window.measuring import Measurement
from ivfmc_ros.window.section import cut_mesh
from ivfmc_ros.window.section import CuttingPlane

# Display units a meter.
SCALE = 100.0
# Points that the profiles of a scan may have in the browser; each second one goes beyond.
_MAX_POINTS = 400_000
# Profiles that are drawn together: one message of some 10 kB instead of one each.
_BATCH = 12
_POINT_SIZE = 0.012  # display units
_LINES, _PLATTER = (90, 98, 110), (206, 210, 216)
_MEASURED = (178, 24, 43)


@dataclass(frozen=True, eq=False, kw_only=True)
class DrawnPoints:
    """
    Points to draw.

    points_xyz : (n, 3) meters, frame ``turntable``
    laser : (n,) index; sigma : (n,) meters; intensity : (n,) DN
    """

    points_xyz: Floats
    laser: Ints
    sigma: Floats
    intensity: Floats

    @classmethod
    def of_profile(cls, profile: Profile) -> 'DrawnPoints':
        """Return the points of a profile."""
        return cls(
            points_xyz=profile.points_xyz,
            laser=np.full(len(profile), profile.laser),
            sigma=profile.sigma,
            intensity=profile.intensity,
        )

    def every(self, step: int) -> 'DrawnPoints':
        """Return each ``step``-th point."""
        return DrawnPoints(
            points_xyz=self.points_xyz[::step],
            laser=self.laser[::step],
            sigma=self.sigma[::step],
            intensity=self.intensity[::step],
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class DrawnMesh:
    """
    A mesh to draw.

    vertices_xyz, faces : (n, 3) meters, (m, 3)
    values : (n,) meters or DN of the vertices, by the name of a mode of coloring
    """

    vertices_xyz: Floats
    faces: Ints
    values: dict[str, Floats] = field(default_factory=dict)

    @property
    def modes(self) -> tuple[str, ...]:
        """Modes in which it can be colored."""
        return (coloring.PLAIN, coloring.HEIGHT, *self.values)


class SceneView:
    """Draws into the scene of a viser server; all methods may be called from any thread."""

    def __init__(self, server: Any) -> None:
        self._server, self._scene = server, server.scene
        self._lock = threading.RLock()
        self._mode = coloring.LASER
        self._mesh_mode = coloring.PLAIN
        self._batch: list[DrawnPoints] = []
        self._drawn: list[tuple[str, DrawnPoints]] = []
        self._count = 0
        self._step = 1
        self._drawn_mesh: DrawnMesh | None = None
        self._section = CuttingPlane()
        self._first_pick: Floats | None = None
        self.on_measured: Callable[[Measurement], object] = lambda measured: None
        self._measuring = False
        server.scene.set_up_direction('+z')
        server.initial_camera.position = (22.0, -18.0, 16.0)
        server.initial_camera.look_at = (0.0, 0.0, 3.0)
        self._scene.configure_default_lights(cast_shadow=False)
        self._scene.on_click()(self._pick)

    def show_cell(self, cell: Cell, radius: float, top: float) -> None:
        """
        Draw camera, light sheets, working volume and platter.

        radius, top : of the working volume, meters
        """
        self._scene.add_frame('/cell', show_axes=False)
        self._lines('/cell/camera', cell_drawing.camera_outline(cell), _LINES)
        for index, sheet in enumerate(cell_drawing.light_sheets(cell, radius, top)):
            self._scene.add_mesh_simple(
                f'/cell/light sheet {sheet.name}',
                SCALE * sheet.vertices_xyz,
                sheet.faces,
                color=coloring.by_laser(np.array([index]))[0],
                opacity=0.15,
                side='double',
                cast_shadow=False,
            )
        disc = cell_drawing.platter(radius)
        self._scene.add_mesh_simple(
            '/platter', SCALE * disc.vertices_xyz, disc.faces, color=_PLATTER, side='double'
        )
        self._lines('/working volume', cell_drawing.volume_outline(radius, top), _LINES)

    def turn_cell(self, angle: float) -> None:
        """Turn the cell about the part: ``angle`` of the table, radians."""
        frame = self._scene.get_handle_by_name('/cell')
        if frame is not None:
            frame.wxyz = (math.cos(-angle / 2), 0.0, 0.0, math.sin(-angle / 2))

    def clear(self) -> None:
        """Remove all points and the mesh: a scan begins."""
        with self._lock:
            self._scene.remove_by_name('/profiles')
            self._scene.remove_by_name('/cloud')
            self._batch, self._drawn = [], []
            self._count, self._step = 0, 1
            self.remove_mesh()
            self.clear_measurement()

    def add_profile(self, points: DrawnPoints) -> None:
        """Draw one profile more, together with some of the next ones."""
        with self._lock:
            self._batch.append(points)
            if len(self._batch) >= _BATCH:
                self.flush()

    def flush(self) -> None:
        """Draw the profiles that wait for others."""
        with self._lock:
            if not self._batch:
                return
            merged, self._batch = _merged(self._batch), []
            thin = merged.every(self._step)
            self._count += len(thin.points_xyz)
            name = f'/profiles/{len(self._drawn):05d}'
            self._drawn.append((name, thin))
            self._draw(name, thin)
            if self._count > _MAX_POINTS:
                self._thin_out()

    def show_cloud(self, points: DrawnPoints) -> None:
        """Draw the registered points instead of the profiles."""
        with self._lock:
            step = 1 + len(points.points_xyz) // _MAX_POINTS
            self._batch = []
            self._scene.remove_by_name('/profiles')
            self._drawn = [('/cloud', points.every(step))]
            self._draw(*self._drawn[0])

    def color_points(self, mode: str) -> None:
        """Color all points by a mode of ``coloring.POINT_MODES``."""
        with self._lock:
            self._mode = mode
            for name, points in self._drawn:
                self._draw(name, points)

    def show_mesh(self, surface: DrawnMesh) -> None:
        """Draw a mesh, and hide the points."""
        with self._lock:
            self._drawn_mesh = surface
            if self._mesh_mode not in surface.modes:
                self._mesh_mode = coloring.PLAIN
            for name, _ in self._drawn:
                handle = self._scene.get_handle_by_name(name)
                if handle is not None:
                    handle.visible = False
            self._draw_mesh()

    def remove_mesh(self) -> None:
        """Remove the mesh."""
        with self._lock:
            self._drawn_mesh = None
            for name in ('/mesh', '/section'):
                self._scene.remove_by_name(name)

    @property
    def mesh_modes(self) -> tuple[str, ...]:
        """Modes in which the mesh can be colored; empty without one."""
        return self._drawn_mesh.modes if self._drawn_mesh is not None else ()

    def color_mesh(self, mode: str) -> tuple[float, float] | None:
        """Color the mesh by one of ``mesh_modes``; returns the limits of the scale, meters."""
        with self._lock:
            self._mesh_mode = mode
            return self._draw_mesh()

    def cut(self, section: CuttingPlane) -> None:
        """Show only one side of a plane, with the outline in it."""
        with self._lock:
            self._section = section
            self._draw_mesh()

    def measure(self, on: bool) -> None:
        """Take the next two clicks as the ends of a distance."""
        with self._lock:
            self._measuring, self._first_pick = on, None
            if on:
                self.clear_measurement()

    def clear_measurement(self) -> None:
        """Remove the distance that was measured."""
        for name in ('/measured', '/measured value'):
            self._scene.remove_by_name(name)

    def _pick(self, event: Any) -> None:
        with self._lock:
            if not self._measuring:
                return
            origin = np.asarray(event.ray_origin) / SCALE
            found = self._nearest(origin, np.asarray(event.ray_direction))
            if found is None:
                return
            if self._first_pick is None:
                self._first_pick = found
                return
            measured = Measurement(first_xyz=self._first_pick, second_xyz=found)
            self._first_pick = None
        ends = np.stack([measured.first_xyz, measured.second_xyz])[None]
        self._lines('/measured', ends, _MEASURED, thickness=3.0)
        self._scene.add_label(
            '/measured value', measured.text, position=SCALE * ends.mean(axis=(0, 1))
        )
        self.on_measured(measured)

    def _nearest(self, origin: Floats, direction: Floats) -> Floats | None:
        """Return the drawn point that a ray meets, meters; None beside all of them."""
        if self._drawn_mesh is not None:
            candidates = self._drawn_mesh.vertices_xyz
        elif self._drawn:
            candidates = np.concatenate([points.points_xyz for _, points in self._drawn])
        else:
            return None
        return Measurement.pick(candidates, origin, direction)

    def _thin_out(self) -> None:
        """Draw half of the points: a browser must not drown in a long scan."""
        self._step *= 2
        self._drawn = [(name, points.every(2)) for name, points in self._drawn]
        self._count = sum(len(points.points_xyz) for _, points in self._drawn)
        for name, points in self._drawn:
            self._draw(name, points)

    def _draw(self, name: str, points: DrawnPoints) -> None:
        if not len(points.points_xyz):
            return
        self._scene.add_point_cloud(
            name,
            (SCALE * points.points_xyz).astype(np.float32),
            self._colors(points),
            point_size=_POINT_SIZE,
            point_shape='circle',
            precision='float32',
            visible=self._drawn_mesh is None,
        )

    def _colors(self, points: DrawnPoints) -> Any:
        if self._mode == coloring.LASER:
            return coloring.by_laser(points.laser)
        values = {
            coloring.HEIGHT: points.points_xyz[:, 2],
            coloring.SIGMA: points.sigma,
            coloring.BRIGHTNESS: points.intensity,
        }[self._mode]
        limits = {coloring.HEIGHT: (0.0, 0.1), coloring.SIGMA: (0.0, 1e-4)}
        # fixed where possible: a batch must not have a scale of its own
        return coloring.by_value(values, *limits.get(self._mode, (0.0, 255.0)))

    def _draw_mesh(self) -> tuple[float, float] | None:
        surface = self._drawn_mesh
        if surface is None:
            return None
        import trimesh

        limits, colors = self._mesh_colors(surface)
        kept, outline = cut_mesh(surface.vertices_xyz, surface.faces, self._section)
        mesh = trimesh.Trimesh(
            SCALE * surface.vertices_xyz,
            surface.faces[kept],
            vertex_colors=colors,
            process=False,
        )
        self._scene.add_mesh_trimesh('/mesh', mesh, cast_shadow=False, receive_shadow=False)
        if len(outline):
            self._lines('/section', outline, _MEASURED)
        else:
            self._scene.remove_by_name('/section')
        return limits

    def _mesh_colors(self, surface: DrawnMesh) -> tuple[tuple[float, float] | None, Any]:
        mode = self._mesh_mode
        if mode == coloring.PLAIN:
            return None, coloring.plain(len(surface.vertices_xyz))
        if mode == coloring.TEXTURE:
            return None, coloring.by_gray(surface.values[mode])
        is_deviation = mode == coloring.DEVIATION
        values = surface.vertices_xyz[:, 2] if mode == coloring.HEIGHT else surface.values[mode]
        limits = coloring.span_of(values, symmetric=is_deviation)
        return limits, coloring.by_value(values, *limits, diverging=is_deviation)

    def _lines(
        self, name: str, segments: Floats, color: tuple[int, int, int], thickness: float = 1.5
    ) -> None:
        self._scene.add_line_segments(
            name,
            (SCALE * segments).astype(np.float32),
            color,
            thickness=thickness,
            thickness_units='screen',
        )


def _merged(parts: list[DrawnPoints]) -> DrawnPoints:
    return DrawnPoints(
        points_xyz=np.concatenate([part.points_xyz for part in parts]),
        laser=np.concatenate([part.laser for part in parts]),
        sigma=np.concatenate([part.sigma for part in parts]),
        intensity=np.concatenate([part.intensity for part in parts]),
    )
