# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Executable ``mesher``: views and their poses to one triangle mesh.

Subscribes to view and view_poses; the service ``build`` writes mesh files into the scan folder and
publishes a decimated mesh on ``mesh`` and ``mesh_shape`` for display.
"""

from collections.abc import Callable
from collections.abc import Mapping
from pathlib import Path
import sys
from typing import Any

from geometry_msgs.msg import PoseArray
from rclpy.task import Future
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import Mesh as MeshMessage
from visualization_msgs.msg import Marker

from ivfmc_ros.errors import BusyError
from ivfmc_ros.errors import NotReadyError
from ivfmc_ros.files import folder_below
from ivfmc_ros.meshing.io.export import FORMATS
from ivfmc_ros.meshing.io.export import require_formats
from ivfmc_ros.model import View
from ivfmc_ros.nodes.convert import clouds
from ivfmc_ros.nodes.convert import meshes
from ivfmc_ros.nodes.convert.stamps import nanoseconds
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.base import run
from ivfmc_ros.nodes.processing import worker_jobs
from ivfmc_ros.nodes.processing.cell_source import CellSource
from ivfmc_ros.pipeline import Settings
from ivfmc_ros.storage.messages.view_poses import to_poses
from ivfmc_ros.worker import Worker

# Seconds without a further view after which no more are expected: views come in one burst.
_QUIET_S = 3.0
# Seconds between two checks whether all views have been received.
_POLL_S = 0.1


class Mesher(CellNode):
    """Keeps the last view of each number, and builds one mesh of them on request."""

    def __init__(self) -> None:
        super().__init__('mesher')
        self._settings = self._declare_parameters()
        self._source = CellSource(self)
        self._views: dict[int, tuple[int, View]] = {}
        self._poses: PoseArray | None = None
        self._received_s = self.steady_s()
        self._complete: Future | None = None
        self._busy = False
        self._worker = Worker()
        self.changed(self._change)
        self._marker = self.publish_on(Marker, 'mesh')
        self._shape = self.publish_on(MeshMessage, 'mesh_shape')
        self.subscribe(PointCloud2, 'view', self._receive_view)
        self.subscribe(PoseArray, 'view_poses', self._receive_poses)
        self.trigger('build', self._build)
        self.trigger('cancel', self._cancel)
        self.steady_timer(_POLL_S, self._check_complete)

    def _declare_parameters(self) -> Callable[[], Settings]:
        self.parameter('scan_id', '', 'Id of the scan; a new one discards the views.')
        self.parameter(
            'scan_root', 'scans', 'Folder of all scans; scan_folder is below it.', read_only=True
        )
        self.parameter(
            'scan_folder',
            '',
            'Folder of the mesh files, below scan_root or relative to it; empty: no files.',
        )
        self.parameter(
            'formats', ['stl', 'ply'], f'Formats of the mesh files, some of {", ".join(FORMATS)}.'
        )
        self.parameter(
            'display_triangles',
            50_000,
            'Maximum number of triangles of the published mesh.',
            low=100,
            high=1_000_000,
        )
        self.check(_require_formats)
        self.check(self._require_scan_folder)
        return self.settings(Settings(), only=('mesh.', 'export_unit'))

    def _require_scan_folder(self, values: Mapping[str, Any]) -> None:
        """:raises ParameterError: the folder is not below ``scan_root``."""
        if values.get('scan_folder'):
            folder_below(Path(values['scan_root']), values['scan_folder'], 'scan_folder')

    def _folder(self) -> str:
        """Return the folder of the mesh files, '' for none."""
        folder = self.get('scan_folder')
        # again: a link may have been made since the parameter was set
        root = Path(self.get('scan_root'))
        return str(folder_below(root, folder, 'scan_folder')) if folder else ''

    def stop(self) -> None:
        """End the worker."""
        self._worker.close()
        super().stop()

    def _change(self, names: set[str]) -> None:
        if 'scan_id' in names:
            self._views.clear()
            self._poses = None
            self._source.reload()

    def _receive_view(self, message: PointCloud2) -> None:
        view = clouds.to_view(message, 'view')
        self._views[view.number] = nanoseconds(message.header.stamp), view
        self._received_s = self.steady_s()

    def _receive_poses(self, message: PoseArray) -> None:
        self._poses = message
        self._received_s = self.steady_s()

    def _cancel(self) -> Mapping[str, Any]:
        if self._busy:
            self._worker.kill()
        return {'cancelled': self._busy}

    async def _build(self) -> Mapping[str, Any]:
        if self._busy:
            raise BusyError('mesher: a mesh is being built already')
        self._busy = True
        try:
            views, message = await self._wait_for_views()
            cell, settings = self._source.cell(), self._settings()
            made = await self.in_thread(
                self._worker.run,
                worker_jobs.build,
                cell,
                views,
                to_poses(message, views, 'view_poses'),
                settings,
                self._folder(),
                self.get('formats'),
                self.get('display_triangles'),
            )
        finally:
            self._busy = False
        stamp = nanoseconds(message.header.stamp)
        self._marker.publish(meshes.marker(made.vertices_xyz, made.faces, stamp))
        self._shape.publish(meshes.mesh_shape(made.vertices_xyz, made.faces))
        return {
            'scan_id': self.get('scan_id'),
            'unit': settings.export_unit,
            'max_edge': made.max_edge,
            'paths': made.paths,
            'counts': made.counts,
            'surface': made.surface,
            'seconds': made.seconds,
        }

    async def _wait_for_views(self) -> tuple[list[View], PoseArray]:
        """
        Return the views of the last poses, and the poses.

        Views are large and may be received after the poses that were published with them.

        :raises NotReadyError: no poses, or no view of theirs, were received
        """
        self._received_s = self.steady_s()
        self._complete = Future()
        self._check_complete()
        await self._complete
        message = self._poses
        if message is None:
            raise NotReadyError(
                f'mesher: nothing received on {self.resolve_topic_name("view_poses")}; '
                'call registrar/register first'
            )
        views = self._views_of(message)
        if not views:
            raise NotReadyError(f'mesher: nothing received on {self.resolve_topic_name("view")}')
        return views, message

    def _views_of(self, message: PoseArray) -> list[View]:
        """Return the views with the stamp of the poses, by number."""
        stamp = nanoseconds(message.header.stamp)
        found = sorted(self._views.items())
        return [
            view for number, (at, view) in found if at == stamp and number < len(message.poses)
        ]

    def _check_complete(self) -> None:
        """Let a build continue when its views are complete, or when no more are received."""
        if self._complete is None or self._complete.done():
            return
        message = self._poses
        complete = message is not None and len(self._views_of(message)) == len(message.poses)
        if complete or self.steady_s() - self._received_s > _QUIET_S:
            self._complete.set_result(None)

    def before_diagnosis(self) -> None:
        """Publish the number of views and whether a mesh is being built."""
        self.status('', views=len(self._views), busy=self._busy)


def _require_formats(values: Mapping[str, Any]) -> None:
    require_formats(values.get('formats') or ())


def main() -> None:
    """Run the node."""
    sys.exit(run(Mesher))


if __name__ == '__main__':
    main()
