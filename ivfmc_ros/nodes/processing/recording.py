# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The recording of one scan: its bag, its rows in the catalogue, and who began it. No ROS."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
import threading
from typing import Any

from ivfmc_ros.errors import ScanError
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.catalogue.catalogue_writer import CatalogueWriter
from ivfmc_ros.storage.catalogue.lost_profiles import remove_lost_profiles
from ivfmc_ros.storage.recording.live_recorder import LiveRecorder
from ivfmc_ros.storage.recording.profile_location import ProfileLocation


class Recording:
    """
    The recording of one scan.

    owner : life of the orchestrator that began it, '' until one is heard
    heard_s : steady second of the owner's last heartbeat, None before
    published : last number that was published on ``recorded``
    finished : set when bag and catalogue are closed
    """

    def __init__(self, scan_id: str, folder: Path, *, owner: str, **options: Any) -> None:
        """
        Open bag and catalogue.

        options : of LiveRecorder; with ``first_profile`` the bag of the scan is gone on with
        :raises ScanError: bag or catalogue cannot be opened
        """
        self.scan_id = scan_id
        self.owner = owner
        self.heard_s: float | None = None
        self.published: int | None = None
        self.finished = threading.Event()
        writer = self.writer = CatalogueWriter(Catalogue(folder.parent, create=True))
        first = options.get('first_profile', 0)
        if first:
            writer.add(lambda catalogue: remove_lost_profiles(catalogue, scan_id, first))
        try:
            self.recorder = LiveRecorder(
                folder,
                on_flush=lambda locations: writer.add(partial(_add_profiles, scan_id, locations)),
                **options,
            )
        except ScanError:
            writer.close()
            raise

    def finish(self) -> Path:
        """
        Write the rest of bag and catalogue; blocks until both are on disk.

        :raises FileError: the bag could not be written
        """
        try:
            return self.recorder.stop()
        finally:
            self.writer.close()
            self.finished.set()


def _add_profiles(
    scan_id: str, locations: Sequence[ProfileLocation], catalogue: Catalogue
) -> None:
    catalogue.add_profiles(scan_id, locations)
