# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Reading of recorded scans.

``open_scan`` yields frames from the images of a bag, ``load_profiles`` the profiles of a scan of
the catalogue, ``scan_contents`` the registered views.
"""

from ivfmc_ros.storage.scans.scan_bag import open_scan as open_scan
from ivfmc_ros.storage.scans.scan_bag import ScanBag as ScanBag
from ivfmc_ros.storage.scans.scan_contents import scan_contents as scan_contents
from ivfmc_ros.storage.scans.scan_contents import ScanContents as ScanContents
from ivfmc_ros.storage.scans.stored_scan import load_profiles as load_profiles
from ivfmc_ros.storage.scans.stored_scan import read_profiles as read_profiles
