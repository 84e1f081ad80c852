# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc demo --offline``: renders a bag, reconstructs it without ROS, compares with the CAD."""

from pathlib import Path
from typing import Any

from ivfmc_ros import files
from ivfmc_ros.cell.camera_file import save_camera
from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.cli.reconstruct import require_right
from ivfmc_ros.cli.reconstruct import say
from ivfmc_ros.cli.support.output import console
from ivfmc_ros.cli.support.progress import progress_bars
from ivfmc_ros.cli.support.reconstruction_options import settings_of
from ivfmc_ros.meshing.io.export import write_solid
from ivfmc_ros.pipeline import reconstruct
from ivfmc_ros.results import write_results
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.solids import demo_part
from ivfmc_ros.simulation.recording import record_scan
from ivfmc_ros.simulation.render.optics import Optics
from ivfmc_ros.simulation.render.optics import with_sheet_thickness
from ivfmc_ros.simulation.render.renderer import simulate_scan
from ivfmc_ros.storage.scans.scan_bag import open_scan
from ivfmc_ros.surface import Surface


def run_offline(output: Path, steps: int, speckle: float, seed: int, **options: Any) -> None:
    """
    Render the pictures of a scan into a bag, and rebuild the part from it.

    steps : pictures a turn, for each laser
    speckle : contrast of the laser speckle, 0 to 1
    options : of the reconstruction, as ``reconstruction_options`` names them; lengths in meters
    :raises ScanError: the folder exists, or a setting makes no sense
    """
    settings = settings_of({**options, 'bottom': max(options['bottom'], 0.5e-3)})
    files.require_new_folder(output)
    optics, part = Optics(speckle=speckle), demo_part()
    cell = with_sheet_thickness(bench_cell(), optics)
    total = steps * len(cell.lasers)
    frames = simulate_scan(cell, part, steps, optics=optics, seed=seed)
    with files.atomic_folder(output) as folder:
        save_cell(folder / 'cell.yaml', cell)
        save_camera(folder / 'camera.yaml', cell.camera)
        write_solid(folder / 'nominal.stl', part.vertices_xyz, part.faces)
        with progress_bars() as progress:
            record_scan(folder / 'bag', cell, frames, total, progress)
            # from here on only what is on disk is used, as for a real scan
            draft = load_draft(folder / 'cell.yaml')
            names = [laser.name for laser in draft.lasers]
            scan = open_scan(folder / 'bag', lasers=names)
            recorded = draft.complete(scan.camera, 'cell.yaml')
            made = reconstruct(recorded, scan.frames(), settings, total, progress)
        nominal = Surface(part.vertices_xyz, part.faces)
        document = write_results(folder / 'result', recorded, made, 'bag', scan.skipped, nominal)
    console().print(f'nominal part: {output / "nominal.stl"}', soft_wrap=True)
    say(output / 'result', document)
    require_right(document)
