# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the topic ``temperature`` says of a scan: for its inspection, and about the calibration."""

from pathlib import Path

from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.nodes.framework.base import CellNode
from ivfmc_ros.nodes.scanning.cell_link import CellLink
from ivfmc_ros.scan.job import Outcome
from ivfmc_ros.scan.temperature import drift_text
from ivfmc_ros.scan.temperature import save_temperature


def declare_temperature_parameters(node: CellNode) -> None:
    """Declare what the temperature of a sensor means for a scan."""
    node.parameter(
        'temperature_u',
        0.5,
        'Standard uncertainty of the readings on the topic temperature that state no variance, K.',
        low=0.0,
        high=50.0,
    )
    node.parameter(
        'max_temperature_change',
        5.0,
        'Difference from temperature_c of cell.yaml that the answer of a scan warns of, K.',
        low=0.1,
        high=100.0,
    )


def record_temperature(node: CellNode, link: CellLink, folder: Path, outcome: Outcome) -> None:
    """
    Store the temperature of a scan in its folder, and say if it is not that of the calibration.

    :raises ScanError: cell.yaml of the scan cannot be read, or the file not be written
    """
    found = link.temperature.summary()
    if found is None:
        return
    save_temperature(folder, found)
    calibrated = load_draft(folder / 'cell.yaml').notes.get('temperature_c')
    if text := drift_text(found, calibrated, node.get('max_temperature_change')):
        outcome.mark('OK', text)
