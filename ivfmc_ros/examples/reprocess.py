# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Builds the meshes of all recorded scans of a folder again, with other settings.

Reads the stored points of each scan through the catalogue; needs no ROS graph:

    python -m ivfmc_ros.examples.reprocess build/demo/scans again --mesh poisson

A scan that fails is reported and does not end the others.
"""

import argparse
from pathlib import Path
import sys

from ivfmc_ros.errors import ScanError
from ivfmc_ros.meshing.settings import MeshSettings
from ivfmc_ros.meshing.settings import METHODS
from ivfmc_ros.pipeline import reconstruct_profiles
from ivfmc_ros.pipeline import Settings
from ivfmc_ros.results import write_results
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.scans.stored_scan import load_profiles


def reprocess(root: Path, scan_id: str, folder: Path, settings: Settings) -> str:
    """
    Build the mesh of one scan into a new folder, and return a line about it.

    :raises ScanError: the scan cannot be read, or makes no surface
    """
    profiles, cell = load_profiles(root, scan_id)
    made = reconstruct_profiles(cell, profiles, settings)
    write_results(folder, cell, made, scan_id, {})
    seconds = sum(made.seconds.values())
    return f'{len(profiles)} profiles, {len(made.mesh.faces)} triangles in {seconds:.1f} s'


def main() -> int:
    """Process all scans; the exit code is the number of scans that failed."""
    parser = argparse.ArgumentParser(description='Build the meshes of recorded scans again.')
    parser.add_argument('scans', type=Path, help='folder with catalogue.sqlite3')
    parser.add_argument('output', type=Path, help='folder to make; one folder a scan in it')
    parser.add_argument('--mesh', choices=METHODS, default='integrate')
    options = parser.parse_args()
    settings = Settings(mesh=MeshSettings(method=options.mesh))
    failed = 0
    for row in Catalogue(options.scans).scans():
        try:
            text = reprocess(options.scans, row.scan_id, options.output / row.scan_id, settings)
        except ScanError as error:
            failed += 1
            text = f'{error.code}: {error}'
        print(f'{row.scan_id}: {text}', flush=True)
    return failed


if __name__ == '__main__':
    sys.exit(main())
