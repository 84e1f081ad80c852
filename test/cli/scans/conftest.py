# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Three recorded scans of one part, and the command that handles them."""

import json

from click.testing import CliRunner
import pytest
from support.recordings import write_profiles

from ivfmc_ros.cli.scans import scans
from ivfmc_ros.storage.archive.rebuild import rebuild_scan
from ivfmc_ros.storage.catalogue.catalogue import Catalogue

IDS = tuple(f'2026112{day}T100000Z_bracket' for day in (5, 6, 7))
DIAMETERS = (10.01e-3, 10.02e-3, 9.99e-3)


def inspection(diameter, verdict='pass'):
    """Return the report of an inspection of one hole; meters."""
    return {
        'created': '2026-11-27T11:00:00Z',
        'verdict': verdict,
        'nominal': 'bracket.stl',
        'characteristics': [
            {
                'feature': 'hole 3',
                'characteristic': 'diameter',
                'nominal_m': 10e-3,
                'measured_m': diameter,
                'U_m': 4e-6,
                'tolerance_m': 0.05e-3,
                'verdict': verdict,
            }
        ],
    }


@pytest.fixture
def command():
    def run(*arguments, **options):
        return CliRunner().invoke(scans, [str(item) for item in arguments], **options)

    return run


@pytest.fixture
def recorded(tmp_path):
    """Folder of three scans with their inspections, and their catalogue."""
    root = tmp_path / 'scans'
    catalogue = Catalogue(root, create=True)
    for name, diameter in zip(IDS, DIAMETERS, strict=True):
        write_profiles(root / name, range(12), per_chunk=3)
        (root / name / 'job.json').write_text('{"stage": "DONE", "code": "OK"}')
        (root / name / 'inspection').mkdir()
        report = root / name / 'inspection' / 'report.json'
        report.write_text(json.dumps(inspection(diameter)))
        rebuild_scan(catalogue, root / name)
    catalogue.close()
    return root
