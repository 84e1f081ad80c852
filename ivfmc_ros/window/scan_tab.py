# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The tab in which a scan is started, followed and ended."""

from collections.abc import Callable
from collections.abc import Mapping
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ivfmc_ros.scan.recipe_verdict import INSPECTION_PAGE
from ivfmc_ros.window.actions import Actions
from ivfmc_ros.window.actions import answered
from ivfmc_ros.window.status_text import features_html
from ivfmc_ros.window.status_text import health_html
from ivfmc_ros.window.status_text import message_html
from ivfmc_ros.window.status_text import scan_state
from ivfmc_ros.window.status_text import ScanState
from ivfmc_ros.window.status_text import STATUS
from ivfmc_ros.window.status_text import verdict_html

_NO_RECIPE = '(none)'


class ScanTab:
    """
    Start, pause, resume, cancel; progress, verdict, health of the nodes.

    state : of the scan that is shown
    """

    def __init__(
        self,
        gui: Any,
        actions: Actions,
        recipes: Sequence[str],
        describe: Callable[[str], str] = lambda name: '',
    ) -> None:
        """
        Add the elements to the container that is open in ``gui``.

        describe : returns as HTML what the recipe of a name sets
        """
        self.state: ScanState = scan_state({})
        self._actions = actions
        self._verdict = gui.add_html('', visible=False)
        self._headline = gui.add_html('')
        self._progress = gui.add_progress_bar(0.0)
        self._message = gui.add_html('', visible=False)
        self._start = gui.add_button('Start scan', color='green', icon='player-play')
        self._pause = gui.add_button('Pause', icon='player-pause', disabled=True)
        self._resume = gui.add_button('Resume', icon='player-track-next', disabled=True)
        self._cancel = gui.add_button('Cancel', color='red', icon='player-stop', disabled=True)
        self._part = gui.add_text('Part', 'part', hint='Name in the catalogue.')
        self._recipe = gui.add_dropdown('Recipe', (_NO_RECIPE, *recipes))
        self._recipe_sets = gui.add_html('', visible=False)
        self._describe = describe
        self._profiles = gui.add_number(
            'Profiles', 200, min=3, max=20_000, step=1, hint='A turn and laser, without a recipe.'
        )
        self._report = gui.add_button('Report', icon='file-text', disabled=True)
        self._features = gui.add_html('', visible=False)
        self._health = gui.add_html('')
        self._recipe.on_update(lambda _: self._show_recipe())
        self._start.on_click(self._on_start)
        self._pause.on_click(lambda event: self._control(event, 'pause', 'Pausing'))
        self._resume.on_click(lambda event: self._control(event, 'resume', 'Going on'))
        self._cancel.on_click(lambda event: self._control(event, 'cancel', 'Cancelled'))
        self._report.on_click(self._on_report)

    def show_status(self, values: Mapping[str, str]) -> None:
        """Show the values of scan_status."""
        state = self.state = scan_state(values)
        self._headline.content = (
            f'<div {STATUS} style="font-size:1.1rem;padding:0 0.6em">{state.headline}'
            f'<br><small>{state.scan_id}</small></div>'
        )
        self._progress.value = state.percent
        for element, html in (
            (self._verdict, verdict_html(state)),
            (self._message, message_html(state)),
            (self._features, features_html(state.result)),
        ):
            if element.content != html:
                element.content = html
            element.visible = bool(html)
        self._start.disabled = state.running
        self._pause.disabled = not state.pausable
        self._resume.disabled = not state.paused
        self._cancel.disabled = not state.running
        self._report.disabled = not state.report

    def show_health(self, nodes: Sequence[tuple[str, str, str]]) -> None:
        """Show (name, level, message) of the nodes."""
        self._health.content = health_html(nodes)

    def _show_recipe(self) -> None:
        """Show what the chosen recipe sets; without one the number of profiles counts."""
        name = self._recipe.value
        is_recipe = name != _NO_RECIPE
        self._recipe_sets.content = self._describe(name) if is_recipe else ''
        self._recipe_sets.visible = is_recipe
        self._profiles.disabled = is_recipe

    def _on_start(self, event: Any) -> None:
        # at once, so that a second click finds it disabled
        self._start.disabled = True
        recipe = self._recipe.value
        values: dict[str, Any] = {'part': self._part.value.strip()}
        if recipe != _NO_RECIPE:
            values['recipe'] = recipe
        else:
            values |= {'recipe': '', 'profiles': int(self._profiles.value)}
        if answered(event, lambda: self._actions.start(values), 'Scan started') is None:
            self._start.disabled = self.state.running

    def _control(self, event: Any, request: str, done: str) -> None:
        answered(event, lambda: self._actions.control(request), done)

    def _on_report(self, event: Any) -> None:
        report = Path(self.state.report)
        for path in (report, report.with_name(INSPECTION_PAGE)):
            # a scan that was not judged has no second one
            if event.client is not None and path.is_file():
                name = f'{self.state.scan_id}_{path.name}'
                event.client.send_file_download(name, path.read_bytes())
