# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Reading and writing of rosbag2 bags (MCAP) without ROS.

``open_bag`` opens a bag, ``find_scan_topics`` finds the topics of a scan in it; ``BagWriter`` and
``create_bag`` write bags.
"""

from ivfmc_ros.storage.bag.reader import Bag as Bag
from ivfmc_ros.storage.bag.reader import open_bag as open_bag
from ivfmc_ros.storage.bag.topics import find_scan_topics as find_scan_topics
from ivfmc_ros.storage.bag.topics import ScanTopics as ScanTopics
from ivfmc_ros.storage.bag.writer import BagWriter as BagWriter
from ivfmc_ros.storage.bag.writer import create_bag as create_bag
