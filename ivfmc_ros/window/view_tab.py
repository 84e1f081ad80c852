# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The tab that controls the 3-D view: colors, section plane, distance of two points."""

from html import escape
from typing import Any

from ivfmc_ros.errors import ScanError
from ivfmc_ros.window import drawn
from ivfmc_ros.window.coloring import bar_html
from ivfmc_ros.window.measuring import Measurement
from ivfmc_ros.window.scene_view import CHOICES
from ivfmc_ros.window.scene_view import SceneView
from ivfmc_ros.window.section import AXES
from ivfmc_ros.window.section import CuttingPlane

_OFF = 'off'
_REACH_MM = 150.0


class ViewTab:
    """Controls of a scene."""

    def __init__(self, gui: Any, scene: SceneView) -> None:
        """Add the elements to the container that is open in ``gui``."""
        self._scene = scene
        self._shown = gui.add_dropdown('Show', CHOICES, hint='Points, until there is a mesh.')
        self._mesh = gui.add_dropdown('Color of mesh', (drawn.PLAIN, drawn.HEIGHT))
        self._mesh_scale = gui.add_html('')
        self._points = gui.add_dropdown('Color of points', drawn.POINT_MODES)
        self._point_scale = gui.add_html('')
        self._axis = gui.add_dropdown('Section across', (_OFF, *AXES))
        self._position = gui.add_slider('Section at, mm', -_REACH_MM, _REACH_MM, 0.5, 0.0)
        self._measure = gui.add_checkbox(
            'Measure: click two points', False, hint='The nearest vertex or point is taken.'
        )
        self._measured = gui.add_html('<div role="status" aria-live="polite"></div>')
        self._shown.on_update(lambda _: scene.show(self._shown.value))
        self._points.on_update(lambda _: self._color_points())
        self._mesh.on_update(lambda _: self._color_mesh())
        self._axis.on_update(lambda _: self._cut())
        self._position.on_update(lambda _: self._cut())
        self._measure.on_update(lambda _: scene.measure(bool(self._measure.value)))
        scene.on_measured = self._show_measured

    def offer_modes(self) -> None:
        """Offer the colors that mesh and points have now, and show those of the mesh."""
        scene = self._scene
        for dropdown, modes in (
            (self._mesh, scene.mesh_modes or (drawn.PLAIN,)),
            (self._points, scene.point_modes),
        ):
            if tuple(dropdown.options) != modes:
                dropdown.options = modes
        if scene.mesh_mode in self._mesh.options:
            self._mesh.value = scene.mesh_mode
        self._color_mesh()
        self._color_points()

    def _color_mesh(self) -> None:
        self._mesh_scale.content = bar_html(self._scene.color_mesh(self._mesh.value))

    def _color_points(self) -> None:
        mode = self._points.value
        try:
            bar = self._scene.color_points(mode)
        except ScanError as error:
            self._point_scale.content = f'<p role="alert">{escape(str(error))}</p>'
            return
        if mode == drawn.DEVIATION and bar is None:
            self._point_scale.content = '<p role="alert">the points do not lie on the nominal</p>'
        else:
            self._point_scale.content = bar_html(bar)

    def _cut(self) -> None:
        axis = self._axis.value
        self._scene.cut(
            CuttingPlane(axis='' if axis == _OFF else axis, position=1e-3 * self._position.value)
        )

    def _show_measured(self, measured: Measurement) -> None:
        self._measured.content = (
            f'<div role="status" aria-live="polite"><b>{measured.text}</b></div>'
        )
