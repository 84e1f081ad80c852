# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Executable ``registrar``: laser profiles to views and their registered poses.

Subscribes to profile; publishes view, view_poses and cloud. The table motion is fitted to the
stamps and provisional angles of the profiles alone, so that live and replayed views are identical.
"""

from collections.abc import Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path
import sys
from typing import Any

from geometry_msgs.msg import PoseArray
import numpy as np
from sensor_msgs.msg import PointCloud2

from ivfmc_ros import pipeline
from ivfmc_ros.errors import LostProfilesError
from ivfmc_ros.errors import NoStripeError
from ivfmc_ros.errors import TimeoutExceededError
from ivfmc_ros.files import folder_below
from ivfmc_ros.model import Poses
from ivfmc_ros.model import Profile
from ivfmc_ros.model import View
from ivfmc_ros.nodes.convert import clouds
from ivfmc_ros.nodes.convert import poses
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.framework.base import run
from ivfmc_ros.nodes.framework.futures import Waiter
from ivfmc_ros.nodes.framework.health import Level
from ivfmc_ros.nodes.processing import worker_jobs
from ivfmc_ros.nodes.processing.cell_source import CellSource
from ivfmc_ros.nodes.processing.exclusive_job import Claim
from ivfmc_ros.nodes.processing.exclusive_job import ExclusiveJob
from ivfmc_ros.pipeline import Settings
from ivfmc_ros.registration.arrivals import Arrivals
from ivfmc_ros.registration.views.assemble import angle_runs
from ivfmc_ros.storage.recording.taken_profiles import read_taken_profiles

# Seconds that profiles may arrive after the request to register them.
_LATE_S = 5.0
# Kinds of conditions.
_TOO_MANY = 'profiles refused'
_MISSING = 'profiles missing'


class Registrar(CellNode):
    """Collects the profiles of a scan and registers their views on request."""

    def __init__(self) -> None:
        super().__init__('registrar')
        self.parameter('scan_id', '', 'Id of the scan; a new one discards the profiles.')
        self.parameter(
            'first_profile',
            0,
            'Number of profiles of an interrupted scan that load reads from its bag.',
            low=0,
            high=10_000_000,
        )
        self.parameter(
            'expected',
            0,
            'Number of profiles that register waits for; 0: those received so far.',
            low=0,
            high=10_000_000,
        )
        self.parameter(
            'most_profiles',
            50_000,
            'Maximum number of profiles, about 35 kB each; register fails if more were received.',
            low=1,
            high=10_000_000,
        )
        self.parameter(
            'merge', [], 'Ids of the scans that the service merge registers together.', kind=str
        )
        self.parameter(
            'scan_root', 'scans', 'Folder of the scans, for merge and load.', read_only=True
        )
        self._settings = self.settings(
            Settings(),
            ranges={'island_least': (1, 1_000_000)},
            only=('island_least', 'registration'),
        )
        self._source = CellSource(self, follows_images=False)
        self._profiles: dict[int, Profile] = {}
        self._refused = 0
        self._stamp_ns = 0
        self._registrations = 0
        self._arrivals = Arrivals()
        self._job = ExclusiveJob(self)
        self._waiter = Waiter(self)
        self.changed(self._change)
        self._views = self.publish_on(PointCloud2, 'view')
        self._poses = self.publish_on(PoseArray, 'view_poses')
        self._cloud = self.publish_on(PointCloud2, 'cloud')
        self.subscribe(PointCloud2, 'profile', self._receive_profile)
        self.trigger('reset', self._reset)
        self.trigger('load', self._load)
        self.trigger('register', self._register)
        self.trigger('merge', self._merge)
        self.trigger('cancel', self._cancel)

    def stop(self) -> None:
        """End the worker."""
        self._job.close()
        super().stop()

    def _change(self, names: set[str]) -> None:
        if 'scan_id' in names:
            # what is still computed belongs to the scan before
            self._job.cancel(f'registrar: scan {self.get("scan_id")} was begun in the meantime')
            self._reset()

    def _receive_profile(self, message: PointCloud2) -> None:
        profile = clouds.to_profile(message, 'profile')
        if profile.seq == 0 and self._profiles:
            # seq 0 is the start of a scan, also without a reset
            self._discard_profiles()
        if len(self._profiles) >= self.get('most_profiles'):
            # a laser that stays on without a scan must not fill the memory
            self._refused += 1
            return
        self._profiles[profile.seq] = profile
        self._stamp_ns = max(self._stamp_ns, profile.stamp_ns) if profile.seq else profile.stamp_ns
        if self.get('registration') == 'joint' and self._arrivals.add(profile):
            self.executor.create_task(self._register_incrementally)

    async def _register_incrementally(self) -> None:
        """Register views one by one as they are completed, for a preview of the final poses."""
        arrivals = self._arrivals
        if not self._source.complete or not arrivals.begin():
            return
        try:
            while profiles := arrivals.next():
                cell, settings = self._source.cell(), self._settings()
                views, _, _ = await self.in_thread(
                    pipeline.assemble_views, cell, profiles, settings
                )
                await self.in_thread(arrivals.place, views)
                if arrivals is self._arrivals and not self._job.busy:
                    # another stamp than the final poses, or a mesher would combine them with views
                    preview = poses.from_transforms(arrivals.poses, self._stamp_ns - 1)
                    self._poses.publish(preview)
            self.health.clear_fault('preview')
        except Exception as error:  # only a preview; ``register`` reports all errors
            self.fault('preview', error)
        finally:
            arrivals.end()

    def _reset(self) -> Mapping[str, Any]:
        dropped = len(self._profiles)
        self._discard_profiles()
        self._registrations = 0
        self._source.reload()
        return {'dropped_profiles': dropped}

    def _discard_profiles(self) -> None:
        self._profiles, self._refused = {}, 0
        self._arrivals = Arrivals()

    async def _load(self) -> Mapping[str, Any]:
        """Read the profiles that an interrupted scan took; those that it takes now follow."""
        scan_id, count = self.get('scan_id'), self.get('first_profile')
        folder = folder_below(Path(self.get('scan_root')), scan_id, 'scan_id')
        taken = await self.in_thread(partial(read_taken_profiles, folder, with_points=True))
        found = {seq: profile for seq, profile in taken.profiles.items() if seq < count}
        if len(found) != count or count > self.get('most_profiles'):
            raise LostProfilesError(
                f'registrar: {len(found)} of {count} profiles of scan {scan_id} are in its bag, '
                f'and at most {self.get("most_profiles")} (most_profiles) are kept'
            )
        self._profiles.update(found)
        self._stamp_ns = max(profile.stamp_ns for profile in self._profiles.values())
        return {'scan_id': scan_id, 'profiles': len(found)}

    def _cancel(self) -> Mapping[str, Any]:
        return {'cancelled': self._job.cancel('registrar: the work was cancelled')}

    async def _merge(self) -> Mapping[str, Any]:
        with self._job.claim('a registration or merge') as claim:
            self._arrivals = Arrivals()
            root, scans = self.get('scan_root'), self.get('merge')
            made = await self._job.run(
                claim, worker_jobs.merge_scans, root, scans, self._settings()
            )
        stamp_ns = self.now_ns()
        self._publish(made.views, made.poses, stamp_ns)
        return {
            'scans': made.placed,
            'stamp_ns': stamp_ns,
            'views': [_summary(view) for view in made.views],
            'seconds': made.seconds,
        }

    async def _wait_for_profiles(self, claim: Claim) -> None:
        """:raises LostProfilesError: fewer profiles were received than ``expected``."""
        expected = self.get('expected')
        # a service request can arrive before profiles that were published earlier
        try:
            await self._waiter.until(
                lambda: len(self._profiles) >= expected, _LATE_S, 'profiles', claim.require
            )
        except TimeoutExceededError as error:
            raise LostProfilesError(
                f'registrar: received {len(self._profiles)} of {expected} profiles; if they are '
                'in the bag, ivfmc reconstruct makes the mesh'
            ) from error

    async def _register(self) -> Mapping[str, Any]:
        with self._job.claim('a registration or merge') as claim:
            await self._wait_for_profiles(claim)
            self._require_all_kept()
            # no preview after the final poses
            self._arrivals = Arrivals()
            profiles = [self._profiles[seq] for seq in sorted(self._profiles)]
            placed = await self._job.run(
                claim, worker_jobs.place, self._source.cell(), profiles, self._settings()
            )
            stamp_ns = self._stamp_ns + self._registrations
            # another stamp when registered again: the mesher must not mix the results
            self._registrations += 1
            # the mesher begins while the surfaces are compared
            self._publish(placed.views, placed.poses, stamp_ns)
            checked = await self._job.run(claim, worker_jobs.check)
        made = worker_jobs.registered_views(placed, checked)
        return {
            'scan_id': self.get('scan_id'),
            'stamp_ns': stamp_ns,
            'missing_profiles': _missing(self._profiles),
            'views': [_summary(view) for view in made.views],
            'verdicts': [asdict(verdict) for verdict in made.verdicts],
            'motions': [asdict(motion) for motion in made.motions],
            'lasers': asdict(made.misfit) if made.misfit else None,
            'table': asdict(made.table),
            'counts': made.counts,
            'seconds': made.seconds,
        }

    def _require_all_kept(self) -> None:
        """:raises ScanError: there are no profiles, or some were refused."""
        if not self._profiles:
            topic = self.resolve_topic_name('profile')
            raise NoStripeError(f'registrar: no profile received on {topic} since the last reset')
        if self._refused:
            raise LostProfilesError(
                f'registrar: {self._refused} profiles were received after the first '
                f'{len(self._profiles)} and not kept; call reset, or raise most_profiles'
            )

    def _publish(self, views: list[View], places: Poses, stamp_ns: int) -> None:
        # one stamp for all, by which the mesher associates views and poses
        for view in views:
            self._views.publish(clouds.from_view(view, stamp_ns))
        self._poses.publish(poses.from_poses(views, places, stamp_ns))
        self._cloud.publish(clouds.from_views(views, places, stamp_ns))

    def before_diagnosis(self) -> None:
        """Publish the number of profiles, and which of them are missing or refused."""
        missing = _missing(self._profiles)
        if self._refused:
            text = f'{self._refused} profiles beyond most_profiles refused; call reset'
            self.health.set(_TOO_MANY, 'profile', Level.ERROR, text, 'profiles are kept again')
        else:
            self.health.clear(_TOO_MANY, 'profile')
        if missing:
            text = f'{missing} profiles are missing'
            self.health.set(_MISSING, 'profile', Level.WARN, text, 'no profile is missing')
        else:
            self.health.clear(_MISSING, 'profile')
        self.status(
            '',
            profiles=len(self._profiles),
            refused=self._refused,
            placed=len(self._arrivals.poses),
            scan_id=self.get('scan_id'),
            busy=self._job.busy,
        )


def _missing(profiles: Mapping[int, Profile]) -> int:
    """Return how many profiles below the highest number were not received."""
    return max(profiles, default=-1) + 1 - len(profiles)


def _summary(view: View) -> Mapping[str, Any]:
    return {
        'view': view.number,
        'laser': view.laser,
        'profiles': len(view.angles),
        'points': int(np.count_nonzero(view.valid)),
        'angle_from': float(view.angles[0]),
        'angle_to': float(view.angles[-1]),
        'runs': angle_runs(view),
    }


def main() -> None:
    """Run the node."""
    sys.exit(run(Registrar))


if __name__ == '__main__':
    main()
