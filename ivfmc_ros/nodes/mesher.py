# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Executable ``mesher``: views and their poses to one triangle mesh.

Subscribes to view and view_poses; the service ``build`` writes mesh files into the scan folder and
publishes a decimated mesh on ``mesh`` and ``mesh_shape`` for display.
"""

from collections.abc import Callable
from collections.abc import Mapping
import contextlib
from pathlib import Path
import sys
from typing import Any

from geometry_msgs.msg import PoseArray
from rclpy.task import Future
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import Mesh as MeshMessage
from visualization_msgs.msg import Marker

from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.volume import Volume
from ivfmc_ros.errors import NotReadyError
from ivfmc_ros.errors import ScanError
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
from ivfmc_ros.nodes.processing.exclusive_job import Claim
from ivfmc_ros.nodes.processing.exclusive_job import ExclusiveJob
from ivfmc_ros.pipeline import Settings
from ivfmc_ros.storage.messages.view_poses import to_poses

# Seconds without a further view after which no more are expected: views come in one burst.
_QUIET_S = 3.0
# Seconds between two checks whether all views have been received.
_POLL_S = 0.1


class Mesher(CellNode):
    """Keeps the last view of each number, and builds one mesh of them on request."""

    def __init__(self) -> None:
        super().__init__('mesher')
        self._settings = self._declare_parameters()
        self._source = CellSource(self, follows_images=False)
        self._views: dict[int, tuple[int, View]] = {}
        self._poses: PoseArray | None = None
        # counts what was received: a mesh that was begun early is of exactly these messages
        self._received = 0
        # of the next build only
        self._poses_stamp_ns = 0
        self._received_s = self.steady_s()
        self._complete: Future | None = None
        self._job = ExclusiveJob(self)
        self.changed(self._change)
        self._marker = self.publish_on(Marker, 'mesh')
        self._shape = self.publish_on(MeshMessage, 'mesh_shape')
        self.subscribe(PointCloud2, 'view', self._receive_view)
        self.subscribe(PoseArray, 'view_poses', self._receive_poses)
        self.trigger('build', self._build)
        self.trigger('cancel', self._cancel)
        self._poll = self.steady_timer(_POLL_S, self._check_complete)
        # runs only while a build waits for views
        self._poll.cancel()

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
            'poses_stamp',
            0,
            'Stamp of the view_poses of the next build, nanoseconds, as the registrar answers it; '
            '0: the last ones.',
            low=0,
            high=2**63 - 1,
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
        for limit in ('radius', 'top'):
            self.parameter(
                f'working_{limit}',
                0.0,
                f'Meters, {limit} of the working volume, by which the mesher tells the rim that '
                'the volume cut (set by the orchestrator); 0: unknown.',
                low=0.0,
                high=10.0,
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
        self._job.close()
        super().stop()

    def _change(self, names: set[str]) -> None:
        if 'scan_id' in names:
            # what is still computed belongs to the scan before
            self._cancel_job(f'mesher: scan {self.get("scan_id")} was begun in the meantime')
            self._views.clear()
            self._poses = None
            self._poses_stamp_ns = 0
            self._source.reload()
        if 'poses_stamp' in names:
            self._poses_stamp_ns = self.get('poses_stamp')

    def _receive_view(self, message: PointCloud2) -> None:
        view = clouds.to_view(message, 'view')
        self._views[view.number] = nanoseconds(message.header.stamp), view
        self._received_s = self.steady_s()
        self._received += 1
        self._begin_early()

    def _receive_poses(self, message: PoseArray) -> None:
        self._poses = message
        self._received_s = self.steady_s()
        self._received += 1
        self._begin_early()

    def _begin_early(self) -> None:
        """Make the mesh of a scan when its views are complete; ``build`` writes its files."""
        message = self._poses
        if message is None or not self.get('scan_folder') or not self._source.complete:
            return
        views = self._views_of(message)
        if views and len(views) == len(message.poses):
            # build reports the error of a cell or of poses that are wrong
            with contextlib.suppress(ScanError):
                cell, settings = self._source.cell(), self._settings()
                placed = to_poses(message, views, 'view_poses')
                key = self._key(cell, settings)
                self._job.begin(worker_jobs.prepare, key, cell, views, placed, settings)

    def _key(self, cell: Cell, settings: Settings) -> tuple[int, int, Settings]:
        """Return what a mesh depends on; the source returns the same cell until it changes."""
        return self._received, id(cell), settings

    def _cancel(self) -> Mapping[str, Any]:
        return {'cancelled': self._cancel_job('mesher: the work was cancelled')}

    def _cancel_job(self, reason: str) -> bool:
        cancelled = self._job.cancel(reason)
        if self._complete is not None and not self._complete.done():
            # it waits for views
            self._complete.set_result(None)
        return cancelled

    async def _build(self) -> Mapping[str, Any]:
        with self._job.claim('a build') as claim:
            views, message = await self._wait_for_views(claim)
            cell, settings = self._source.cell(), self._settings()
            made = await self._job.run(
                claim,
                worker_jobs.build,
                cell,
                views,
                to_poses(message, views, 'view_poses'),
                settings,
                worker_jobs.MeshOutput(
                    folder=self._folder(),
                    suffixes=self.get('formats'),
                    triangles=self.get('display_triangles'),
                    volume=self._volume(),
                ),
                self._key(cell, settings),
            )
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

    def _volume(self) -> Volume | None:
        """Return the working volume of the scan; None if it is unknown."""
        radius, top = self.get('working_radius'), self.get('working_top')
        return Volume(radius=radius, top=top) if radius and top else None

    async def _wait_for_views(self, claim: Claim) -> tuple[list[View], PoseArray]:
        """
        Return the views of the last poses, and the poses.

        Views are large and may be received after the poses that were published with them.

        :raises NotReadyError: no poses, or no view of theirs, were received
        :raises CancelledError: the build was cancelled
        """
        self._received_s = self.steady_s()
        self._complete = Future()
        self._poll.reset()
        self._check_complete()
        await self._complete
        self._poll.cancel()
        claim.require()
        message, stamp_ns = self._expected_poses(), self._poses_stamp_ns
        self._poses_stamp_ns = 0
        if message is None:
            stamp = f' with the stamp {stamp_ns} ns' if stamp_ns else ''
            raise NotReadyError(
                f'mesher: nothing received on {self.resolve_topic_name("view_poses")}{stamp}; '
                'call registrar/register first'
            )
        views = self._views_of(message)
        if not views:
            raise NotReadyError(f'mesher: nothing received on {self.resolve_topic_name("view")}')
        return views, message

    def _expected_poses(self) -> PoseArray | None:
        """Return the last poses, None where they are not those of this scan."""
        message, awaited_ns = self._poses, self._poses_stamp_ns
        if message is None or (awaited_ns and nanoseconds(message.header.stamp) != awaited_ns):
            return None
        return message

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
        message = self._expected_poses()
        complete = message is not None and len(self._views_of(message)) == len(message.poses)
        if complete or self.steady_s() - self._received_s > _QUIET_S:
            self._complete.set_result(None)

    def before_diagnosis(self) -> None:
        """Publish the number of views and whether a mesh is being built."""
        self.status('', views=len(self._views), busy=self._job.busy)


def _require_formats(values: Mapping[str, Any]) -> None:
    require_formats(values.get('formats') or ())


def main() -> None:
    """Run the node."""
    sys.exit(run(Mesher))


if __name__ == '__main__':
    main()
