# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The page: tabs and 3-D scene in one viser server, behind a gate."""

from collections.abc import Callable
from collections.abc import Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
import io
from pathlib import Path
from typing import Any

from ivfmc_ros.errors import NotReadyError
from ivfmc_ros.scan.recipe import InspectionPlan
from ivfmc_ros.window.access import Access
from ivfmc_ros.window.actions import Actions
from ivfmc_ros.window.calibrate_tab import CalibrateTab
from ivfmc_ros.window.drawn import DrawnMesh
from ivfmc_ros.window.gate import Gate
from ivfmc_ros.window.history_tab import HistoryTab
from ivfmc_ros.window.placed_nominal import fit_nominal
from ivfmc_ros.window.placed_nominal import PlacedNominal
from ivfmc_ros.window.recipe_text import recipe_html
from ivfmc_ros.window.scan_tab import ScanTab
from ivfmc_ros.window.scene_view import SceneView
from ivfmc_ros.window.view_tab import ViewTab
from ivfmc_ros.window.work_tab import WorkTab


@dataclass(frozen=True, kw_only=True)
class PageSetup:
    """
    What a page is made with.

    title : name of the cell
    scans, pictures : folders of the scans, and of the pictures of the guided calibration
    lasers : names, in the order of the cell
    size : (width, height) of the camera's images, pixels
    recipes : names, and the folder in which they are; None for no recipes
    """

    title: str
    scans: Path
    pictures: Path
    lasers: Sequence[str]
    size: tuple[int, int]
    recipes: Sequence[str] = ()
    recipe_root: Path | None = None


class ViewPage:
    """
    The 3-D view alone, for files.

    scene : what is drawn; view_tab : its controls
    """

    def __init__(
        self, title: str, address: str, port: int, access: Access, log: Callable[[str], object]
    ) -> None:
        """
        Serve a page.

        :raises ParameterError: the address is taken, or not of this computer
        :raises NotReadyError: viser is not installed
        """
        self._server = start_server(title)
        self.scene = SceneView(self._server)
        self.build(self._server.gui)
        try:
            self._gate = Gate(address, port, self._server.get_port(), access, log)
        except BaseException:
            self._server.stop()
            raise

    def build(self, gui: Any) -> None:
        """Add the elements beside the scene; a subclass adds more."""
        self.view_tab = ViewTab(gui, self.scene)

    @property
    def port(self) -> int:
        """The port that browsers connect to."""
        return self._gate.port

    @property
    def browsers(self) -> int:
        """The number of browsers that show the page."""
        return len(self._server.get_clients())

    def on_browser(self, callback: Callable[[], object]) -> None:
        """Call ``callback``, in a thread of the server, when a browser begins to show the page."""
        self._server.on_client_connect(lambda _: callback())

    @property
    def refused(self) -> int:
        """The number of requests that were refused."""
        return self._gate.refused.total()

    def show_mesh(self, mesh: DrawnMesh) -> None:
        """Draw a mesh, and offer its colors."""
        self.scene.show_mesh(mesh)
        self.view_tab.offer_modes()

    def place_nominal(self, nominal: PlacedNominal | None) -> None:
        """Offer the deviations of the points from a nominal; None: from none."""
        self.scene.place_nominal(nominal)
        self.view_tab.offer_modes()

    def offer_fit(self, plan: InspectionPlan) -> None:
        """Offer provisional deviations of the points from the nominal of a plan."""
        self.scene.offer_fit(lambda points_xyz: fit_nominal(points_xyz, plan))
        self.view_tab.offer_modes()

    def clear(self) -> None:
        """Remove what is drawn of a scan: another one begins."""
        self.scene.clear()
        self.view_tab.offer_modes()

    def close(self) -> None:
        """End all connections."""
        self._gate.stop()
        with redirect_stdout(io.StringIO()):
            self._server.stop()


class WorkPage(ViewPage):
    """The whole work window of a cell."""

    def __init__(
        self,
        setup: PageSetup,
        actions: Actions,
        *,
        address: str,
        port: int,
        access: Access,
        log: Callable[[str], object],
    ) -> None:
        """
        Serve the page of a cell.

        :raises ParameterError: the address is taken, or not of this computer
        :raises NotReadyError: viser is not installed
        """
        self._setup, self._actions = setup, actions
        super().__init__(setup.title, address, port, access, log)
        self.history.refresh()

    def build(self, gui: Any) -> None:
        """Add all tabs."""
        tabs = gui.add_tab_group()
        setup = self._setup
        with tabs.add_tab('Scan', 'player-play'):
            self.scan = ScanTab(gui, self._actions, setup.recipes, self._describe)
        with tabs.add_tab('Work', 'camera'):
            self.work = WorkTab(gui, self._actions, setup.lasers, setup.size)
        with tabs.add_tab('3-D', 'cube'):
            super().build(gui)
        with tabs.add_tab('Calibrate', 'ruler-measure'):
            self.calibrate = CalibrateTab(gui, setup.pictures)
        with tabs.add_tab('History', 'history'):
            self.history = HistoryTab(gui, setup.scans, self.show_mesh)

    def _describe(self, recipe: str) -> str:
        root = self._setup.recipe_root
        return '' if root is None else recipe_html(root, recipe)


def start_server(title: str) -> Any:
    """
    Return a viser server on a free port of the loopback interface.

    :raises NotReadyError: viser is not installed
    """
    try:
        import viser
    except ImportError as error:
        raise NotReadyError(
            f"the window needs viser: pip install 'ivfmc_ros[window]' ({error})"
        ) from error
    # it prints a banner with a port that is not for browsers
    with redirect_stdout(io.StringIO()):
        server = viser.ViserServer('127.0.0.1', 0, label=title, verbose=False)
    # a browser must not be able to publish the cell on the internet
    server.request_share_url = lambda *_: None  # type: ignore[method-assign]
    server.gui.configure_theme(
        control_layout='fixed',
        control_width='large',
        show_logo=False,
        show_share_button=False,
    )
    return server
