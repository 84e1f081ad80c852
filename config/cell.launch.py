# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A cell, for launch files in Python: includes ``cell.launch.xml`` with all its arguments.

    ros2 launch ivfmc_ros cell.launch.py cell:=/path/to/cell.yaml window:=true
    ros2 launch ivfmc_ros cell.launch.py --show-args

The nodes are declared in the XML file alone. They are processes of their own: Python nodes cannot
be composed into one.
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import AnyLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

# Arguments without a default: an include demands that they are handed on.
REQUIRED = ('cell',)


def generate_launch_description() -> LaunchDescription:
    """Return the description of a cell; its arguments are those of the XML file."""
    source = AnyLaunchDescriptionSource(str(Path(__file__).with_name('cell.launch.xml')))
    handed_on = [(name, LaunchConfiguration(name)) for name in REQUIRED]
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(name) for name in REQUIRED),
            IncludeLaunchDescription(source, launch_arguments=handed_on),
        ]
    )
