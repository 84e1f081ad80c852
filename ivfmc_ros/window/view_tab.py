# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The tab that controls the 3-D view: colors, section plane, distance of two points."""

from typing import Any

from ivfmc_ros.window import coloring
from ivfmc_ros.window.measuring import Measurement
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
        self._points = gui.add_dropdown('Color of points', coloring.POINT_MODES)
        self._mesh = gui.add_dropdown('Color of mesh', (coloring.PLAIN, coloring.HEIGHT))
        self._scale = gui.add_html('')
        self._axis = gui.add_dropdown('Section across', (_OFF, *AXES))
        self._position = gui.add_slider('Section at, mm', -_REACH_MM, _REACH_MM, 0.5, 0.0)
        self._measure = gui.add_checkbox(
            'Measure: click two points', False, hint='The nearest vertex or point is taken.'
        )
        self._measured = gui.add_html('<div role="status" aria-live="polite"></div>')
        self._points.on_update(lambda _: scene.color_points(self._points.value))
        self._mesh.on_update(lambda _: self._color())
        self._axis.on_update(lambda _: self._cut())
        self._position.on_update(lambda _: self._cut())
        self._measure.on_update(lambda _: scene.measure(bool(self._measure.value)))
        scene.on_measured = self._show_measured

    def offer_modes(self) -> None:
        """Offer the colors that the present mesh has."""
        modes = self._scene.mesh_modes or (coloring.PLAIN,)
        if tuple(self._mesh.options) != modes:
            self._mesh.options = modes

    def _color(self) -> None:
        limits = self._scene.color_mesh(self._mesh.value)
        self._scale.content = (
            f'<small>scale: {1e3 * limits[0]:+.3f} to {1e3 * limits[1]:+.3f} mm</small>'
            if limits
            else ''
        )

    def _cut(self) -> None:
        axis = self._axis.value
        self._scene.cut(
            CuttingPlane(axis='' if axis == _OFF else axis, position=1e-3 * self._position.value)
        )

    def _show_measured(self, measured: Measurement) -> None:
        self._measured.content = (
            f'<div role="status" aria-live="polite"><b>{measured.text}</b></div>'
        )
