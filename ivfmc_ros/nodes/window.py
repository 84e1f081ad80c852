# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Executable ``window``: a page that shows the cell in a browser, and a client like any other.

No node depends on it. What the scan needs is received best effort where it comes often, so that a
slow page slows nothing down; pictures only while a browser shows the page.
"""

from collections.abc import Mapping
from pathlib import Path
import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
from sensor_msgs.msg import JointState
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import Mesh as MeshMessage

from ivfmc_ros.access_token import read_token
from ivfmc_ros.access_token import require_token
from ivfmc_ros.errors import ScanError
from ivfmc_ros.nodes.convert import clouds
from ivfmc_ros.nodes.convert import meshes
from ivfmc_ros.nodes.framework import qos
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.base import run
from ivfmc_ros.nodes.processing.cell_source import CellSource
from ivfmc_ros.nodes.viewing.browser_timer import BrowserTimer
from ivfmc_ros.nodes.viewing.cell_actions import CellActions
from ivfmc_ros.nodes.viewing.node_health import NodeHealth
from ivfmc_ros.nodes.viewing.picture_feed import PictureFeed
from ivfmc_ros.scan.recipe import recipe_names
from ivfmc_ros.storage.matching.joint_history import joint_in_message
from ivfmc_ros.window.access import Access
from ivfmc_ros.window.drawn import DrawnMesh
from ivfmc_ros.window.drawn import DrawnPoints
from ivfmc_ros.window.mesh_files import load_mesh
from ivfmc_ros.window.page import PageSetup
from ivfmc_ros.window.page import WorkPage
from ivfmc_ros.window.placed_nominal import load_placed_nominal
from ivfmc_ros.window.placed_nominal import PlacedNominal
from ivfmc_ros.window.placed_nominal import plan_of_scan
from ivfmc_ros.window.status_text import ENDED

# Seconds between two looks at profiles that wait to be drawn, while a browser shows the page.
_FOLLOW_S = 0.1
# Seconds between two looks at the health of the nodes, and at a cell that is not drawn yet.
_HEALTH_S = 1.0
# Radians that the table turns until the drawn cell follows.
_TURN = 0.02
# Stages in which registrar and mesher publish for the scan.
_PROCESSING = ('REGISTERING', 'MESHING', 'INSPECTING', 'FINISHING')
# Size of the camera's images while it is not known.
_SIZE = (1280, 1024)


class Window(CellNode):
    """Hands what the cell publishes to a page, and the page's requests to the cell."""

    def __init__(self) -> None:
        super().__init__('window')
        self._declare_parameters()
        self._source = CellSource(self)
        self._actions = CellActions(self)
        self._health = NodeHealth(self.get_namespace(), self.steady_s)
        self._page = self._open_page()
        self._pictures = PictureFeed(self, self._page, self._actions)
        self._is_cell_drawn = False
        self._scan_id: str | None = None
        self._drawn_angle = 0.0
        # the scan whose mesh file is drawn
        self._mesh_of = ''
        self.subscribe(DiagnosticStatus, 'scan_status', self._receive_status)
        self.create_subscription(
            DiagnosticArray,
            '/diagnostics',
            self.guarded(self._receive_diagnostics, 'diagnostics'),
            qos.reliable(50),
        )
        for kind, topic, callback in (
            (PointCloud2, 'profile', self._receive_profile),
            (JointState, 'joint_states', self._receive_joints),
        ):
            self.create_subscription(
                kind, topic, self.guarded(callback, topic), qos.best_effort(qos.PROFILE_DEPTH)
            )
        self.subscribe(PointCloud2, 'cloud', self._receive_cloud)
        self.create_subscription(
            MeshMessage,
            'mesh_shape',
            self.guarded(self._receive_mesh, 'mesh_shape'),
            qos.latched(),
            raw=True,
        )
        self._browsers = BrowserTimer(self, self._page, _FOLLOW_S, self._follow)
        self.steady_timer(_HEALTH_S, self._watch_cell)

    def _declare_parameters(self) -> None:
        def fixed(name: str, default: Any, text: str, **limits: Any) -> None:
            self.parameter(name, default, text, read_only=True, **limits)

        fixed('address', '127.0.0.1', 'IP address to listen on; any but loopback needs a token.')
        fixed('port', 8088, 'Port for browsers; 0: a free one.', low=0, high=65535)
        fixed('token_file', '', 'File with the token that browsers have to show; empty: none.')
        fixed('scan_root', 'scans', 'Folder of all scans, for the history.')
        fixed('recipe_root', '', 'Folder of the recipes; empty: none.')
        fixed('pictures', 'calibration_pictures', 'Folder of pictures of the guided calibration.')
        fixed('joint', 'turntable_joint', 'Name of the joint of the table.')
        self.parameter('radius', 0.06, 'Meters, of the drawn working volume.', low=1e-3, high=10.0)
        self.parameter('top', 0.1, 'Meters, of the drawn working volume.', low=1e-3, high=10.0)

    def _open_page(self) -> WorkPage:
        address, path = self.get('address'), self.get('token_file')
        token = read_token(Path(path).expanduser() if path else None)
        require_token(address, token, 'token_file')
        draft = self._source.draft
        root = self._recipe_root
        page = WorkPage(
            PageSetup(
                title=self.get_namespace(),
                scans=Path(self.get('scan_root')),
                pictures=Path(self.get('pictures')),
                lasers=[laser.name for laser in draft.lasers] if draft else [],
                size=self._source.cell().camera.size if self._source.complete else _SIZE,
                recipes=() if root is None else recipe_names(root),
                recipe_root=root,
            ),
            self._actions,
            address=address,
            port=self.get('port'),
            access=Access(token=token),
            log=self.get_logger().warning,
        )
        self.get_logger().info(f'page: http://{address}:{page.port}')
        return page

    def _follow(self, has_browser: bool) -> None:
        """Follow the browsers; without one for the last time."""
        self._pictures.follow(wanted=has_browser, scanning=self._page.scan.state.running)
        if has_browser:
            self._page.scene.flush()

    def _draw_cell(self) -> None:
        if self._is_cell_drawn or not self._source.complete:
            return
        self._page.scene.show_cell(self._source.cell(), self.get('radius'), self.get('top'))
        self._is_cell_drawn = True
        # nothing else is needed of it
        self._source.infos.pause()

    def _watch_cell(self) -> None:
        self._draw_cell()
        if self._page.browsers:
            self._page.scan.show_health(self._health.rows())

    def _receive_status(self, message: DiagnosticStatus) -> None:
        values = {item.key: item.value for item in message.values}
        scan_id = values.get('scan_id', '')
        if scan_id != self._scan_id:
            self._scan_id = scan_id
            self._page.clear()
        self._page.scan.show_status(values)
        state = self._page.scan.state
        self._actions.idle = not state.running
        self._page.work.permit(idle=self._actions.idle)
        if state.stage in ENDED:
            self._page.scene.flush()
            self._show_result(state.result, scan_id)

    def _show_result(self, result: Mapping[str, Any], scan_id: str) -> None:
        """Draw the mesh file of a scan, which has more than the published mesh."""
        path = Path(str(result.get('files', {}).get('mesh.ply', '')))
        if scan_id == self._mesh_of or not path.is_file():
            return
        self._mesh_of = scan_id
        unit = str(result.get('parameters', {}).get('export_unit', 'mm'))
        self.executor.create_task(self._load_mesh, path, unit, scan_id)

    async def _load_mesh(self, path: Path, unit: str, scan_id: str) -> None:
        nominal: PlacedNominal | None = None
        try:
            nominal = await self.in_thread(load_placed_nominal, path.parent)
        except ScanError as error:
            self.get_logger().warning(f'the mesh is drawn without its deviation: {error}')
        try:
            mesh = await self.in_thread(load_mesh, path, unit, nominal)
        except ScanError as error:
            # the published mesh is drawn already
            self.get_logger().warning(f'the mesh is not drawn from its file: {error}')
            return
        if scan_id == self._scan_id:
            self._page.place_nominal(nominal)
            self._page.show_mesh(mesh)
            self._page.history.refresh()

    def _receive_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self._health.add(status)

    def _receive_profile(self, message: PointCloud2) -> None:
        profile = clouds.to_profile(message, 'profile')
        self._pictures.profile = profile
        if len(profile):
            self._page.scene.add_profile(DrawnPoints.of_profile(profile))

    def _receive_joints(self, message: JointState) -> None:
        state = joint_in_message(message, self.get('joint'))
        if state is None:
            return
        self._actions.position = state[0]
        if self._page.browsers and abs(state[0] - self._drawn_angle) > _TURN:
            self._drawn_angle = state[0]
            self._page.scene.turn_cell(state[0])

    @property
    def _recipe_root(self) -> Path | None:
        root = self.get('recipe_root')
        return Path(root) if root else None

    @property
    def _is_scanned(self) -> bool:
        """Whether the profiles of the scan are complete; what comes earlier is of the last one."""
        return self._page.scan.state.stage in (*_PROCESSING, *ENDED)

    def _receive_cloud(self, message: PointCloud2) -> None:
        if not self._is_scanned:
            return
        names = ('x', 'y', 'z', 'sigma', 'intensity', 'laser')
        records = clouds.to_structured_array(message, 'cloud', names).ravel()
        self._page.scene.show_cloud(
            DrawnPoints(
                points_xyz=np.stack([records[name].astype(float) for name in names[:3]], axis=1),
                laser=records['laser'].astype(int),
                sigma=records['sigma'].astype(float),
                intensity=records['intensity'].astype(float),
            )
        )
        self._offer_deviation()

    def _offer_deviation(self) -> None:
        """Offer the deviation of the cloud while the mesh is built and inspected."""
        if self._page.scan.state.stage not in _PROCESSING:
            return
        try:
            plan = plan_of_scan(Path(self.get('scan_root')) / str(self._scan_id))
        except ScanError as error:
            self.get_logger().warning(f'no deviation is shown before the inspection: {error}')
            return
        if plan is not None:
            self._page.offer_fit(plan)

    def _receive_mesh(self, data: bytes) -> None:
        vertices, faces = meshes.from_mesh_shape(data)
        if len(faces) and self._is_scanned and self._scan_id != self._mesh_of:
            self._page.show_mesh(DrawnMesh(vertices_xyz=vertices, faces=faces))

    def before_diagnosis(self) -> None:
        """Publish how many browsers show the page."""
        self.status(
            'serving the page',
            port=self._page.port,
            browsers=self._page.browsers,
            refused=self._page.refused,
        )

    def stop(self) -> None:
        """End all connections to browsers."""
        self._page.close()


def main() -> None:
    """Run the node."""
    sys.exit(run(Window))


if __name__ == '__main__':
    main()
