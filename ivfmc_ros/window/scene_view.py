# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The 3-D view: profiles as they come, the registered cloud, the mesh, and the cell around them.

Objects are drawn in centimeters in the frame ``turntable``, so that near and far planes of the
browser's camera fit; the cell turns about the part. A browser gets a bounded number of points,
however long a scan is.
"""

from collections.abc import Callable
import math
import threading
from typing import Any

import numpy as np

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.inspection.reports.color_scale import ColorBar
from ivfmc_ros.model import Floats
from ivfmc_ros.window import cell_drawing
from ivfmc_ros.window import coloring
from ivfmc_ros.window import drawn
from ivfmc_ros.window.drawn import DrawnMesh
from ivfmc_ros.window.drawn import DrawnPoints
from ivfmc_ros.window.measuring import Measurement
from ivfmc_ros.window.placed_nominal import PlacedNominal
from ivfmc_ros.window.section import cut_mesh
from ivfmc_ros.window.section import CuttingPlane

# What is shown of a scan that has a mesh.
MESH, POINTS, BOTH = 'mesh', 'points', 'mesh and points'
CHOICES = (MESH, POINTS, BOTH)
# Display units a meter.
SCALE = 100.0
# Points that the profiles of a scan may have in the browser; each second one goes beyond.
_MAX_POINTS = 400_000
# Profiles that are drawn together: one message of some 10 kB instead of one each.
_BATCH = 12
_POINT_SIZE = 0.012  # display units
_LINES, _PLATTER = (90, 98, 110), (206, 210, 216)
_MEASURED = (178, 24, 43)
# Intensities of three.js: pi of both together shows a color as it is.
_AMBIENT, _DIRECTED = 2.1, 1.0
# Directions from which light comes, in display units: from above left and from the other side.
_LIGHTS = ((10.0, -30.0, 40.0), (-30.0, 20.0, 10.0))


class SceneView:
    """Draws into the scene of a viser server; all methods may be called from any thread."""

    def __init__(self, server: Any) -> None:
        self._server, self._scene = server, server.scene
        self._lock = threading.RLock()
        self._mode = drawn.LASER
        self._mesh_mode = drawn.PLAIN
        self._mesh_bar: ColorBar | None = None
        self._choice = MESH
        self._nominal: PlacedNominal | None = None
        self._fit: Callable[[Floats], PlacedNominal | None] | None = None
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
        self._light()
        self._scene.on_click()(self._pick)

    def _light(self) -> None:
        """Light the scene evenly: the color of a deviation must stay readable on every side."""
        self._scene.configure_default_lights(enabled=False, cast_shadow=False)
        self._scene.configure_environment_map(None)
        self._scene.add_light_ambient('/lights/ambient', intensity=_AMBIENT)
        for number, place in enumerate(_LIGHTS):
            self._scene.add_light_directional(
                f'/lights/{number}', intensity=_DIRECTED, position=place
            )

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
            self._nominal = self._fit = None
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
            merged, self._batch = DrawnPoints.merged(self._batch), []
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

    @property
    def point_modes(self) -> tuple[str, ...]:
        """Modes in which the points can be colored."""
        has_deviation = self._nominal is not None or self._fit is not None
        return (*drawn.POINT_MODES, *((drawn.DEVIATION,) if has_deviation else ()))

    def color_points(self, mode: str) -> ColorBar | None:
        """
        Color all points by one of ``point_modes``.

        :returns: the scale, None without one
        :raises ScanError: the nominal could not be placed
        """
        if mode == drawn.DEVIATION:
            self._fit_nominal()
        with self._lock:
            if mode != self._mode:
                self._mode = mode
                for name, points in self._drawn:
                    self._draw(name, points)
            return coloring.point_bar(mode, self._nominal)

    def place_nominal(self, nominal: PlacedNominal | None) -> None:
        """Offer the deviations of the points from a nominal; None: from none."""
        with self._lock:
            self._nominal, self._fit = nominal, None
            if self._mode == drawn.DEVIATION:
                for name, points in self._drawn:
                    self._draw(name, points)

    def offer_fit(self, fit: Callable[[Floats], PlacedNominal | None]) -> None:
        """Offer deviations from a nominal that is placed when they are asked for."""
        with self._lock:
            self._fit = fit

    def _fit_nominal(self) -> None:
        """Place the nominal by the points, without keeping those waiting that come."""
        with self._lock:
            fit, parts = self._fit, [points for _, points in self._drawn]
        if fit is None or not parts:
            return
        nominal = fit(DrawnPoints.merged(parts).points_xyz)
        with self._lock:
            # the inspection may have placed it meanwhile, or another scan begun
            if self._fit is fit:
                self._nominal, self._fit = nominal, None

    def show(self, choice: str) -> None:
        """Show what one of ``CHOICES`` names; the points where there is no mesh yet."""
        with self._lock:
            self._choice = choice
            for name in (*(name for name, _ in self._drawn), '/mesh'):
                handle = self._scene.get_handle_by_name(name)
                if handle is not None:
                    handle.visible = (
                        choice != POINTS if name == '/mesh' else self._are_points_shown
                    )

    @property
    def _are_points_shown(self) -> bool:
        return self._choice != MESH or self._drawn_mesh is None

    def show_mesh(self, surface: DrawnMesh) -> None:
        """Draw a mesh, by its deviation if it has one; the points are hidden unless chosen."""
        with self._lock:
            self._drawn_mesh = surface
            if drawn.DEVIATION in surface.modes:
                self._mesh_mode = drawn.DEVIATION
            elif self._mesh_mode not in surface.modes:
                self._mesh_mode = drawn.PLAIN
            self._draw_mesh()
            self.show(self._choice)

    def remove_mesh(self) -> None:
        """Remove the mesh."""
        with self._lock:
            self._drawn_mesh = self._mesh_bar = None
            for name in ('/mesh', '/section'):
                self._scene.remove_by_name(name)

    @property
    def mesh_mode(self) -> str:
        """The mode in which the mesh is colored."""
        return self._mesh_mode

    @property
    def mesh_modes(self) -> tuple[str, ...]:
        """Modes in which the mesh can be colored; empty without one."""
        return self._drawn_mesh.modes if self._drawn_mesh is not None else ()

    def color_mesh(self, mode: str) -> ColorBar | None:
        """Color the mesh by one of ``mesh_modes``; returns the scale, None without one."""
        with self._lock:
            if mode != self._mesh_mode:
                self._mesh_mode = mode
                self._draw_mesh()
            return self._mesh_bar

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
        if self._drawn_mesh is not None and self._choice != POINTS:
            candidates = self._section.near_side(self._drawn_mesh.vertices_xyz)
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
            coloring.color_points(points, self._mode, self._nominal),
            point_size=_POINT_SIZE,
            point_shape='circle',
            precision='float32',
            visible=self._are_points_shown,
        )

    def _draw_mesh(self) -> None:
        surface = self._drawn_mesh
        if surface is None:
            return
        import trimesh

        colors, self._mesh_bar = coloring.color_mesh(surface, self._mesh_mode)
        kept, outline = cut_mesh(surface.vertices_xyz, surface.faces, self._section)
        # glTF's own default is a metal, which shows its surroundings instead of its color
        visuals: Any = trimesh.visual
        material = visuals.material.PBRMaterial(metallicFactor=0.0, roughnessFactor=1.0)
        visual = visuals.TextureVisuals(material=material)
        visual.vertex_attributes['color'] = coloring.linear(colors)
        mesh = trimesh.Trimesh(
            SCALE * surface.vertices_xyz, surface.faces[kept], visual=visual, process=False
        )
        self._scene.add_mesh_trimesh(
            '/mesh',
            mesh,
            cast_shadow=False,
            receive_shadow=False,
            visible=self._choice != POINTS,
        )
        if len(outline):
            self._lines('/section', outline, _MEASURED)
        else:
            self._scene.remove_by_name('/section')

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
