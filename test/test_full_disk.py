# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writing in a child process with a limited file size (RLIMIT_FSIZE) fails as on a full disk."""

import os
from pathlib import Path
import subprocess
import sys

ROOT = Path(__file__).resolve().parents[1]

_SETUP = """
import resource, signal, sys
from pathlib import Path
import numpy as np
import trimesh
from support.synthetic import Sphere, small_cell, sphere_profiles
from ivfmc_ros.errors import FileError
from ivfmc_ros.meshing.io.export import write_solid
from ivfmc_ros.pipeline import reconstruct_profiles
from ivfmc_ros.results import write_results

folder = Path(sys.argv[1])
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)

def limited(size, write, *arguments):
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))
    try:
        write(*arguments)
    except FileError as error:
        print(error)
"""
_MESHES = """
ball = trimesh.creation.icosphere(5)
for name in ('mesh.stl', 'mesh.ply', 'mesh.obj', 'mesh.glb'):
    limited(100_000, write_solid, folder / name, ball.vertices, ball.faces)
"""
_RESULTS = """
cell = small_cell()
ball = Sphere(np.array([0.004, 0.002, 0.03]), 0.025)
made = reconstruct_profiles(cell, sphere_profiles(cell, ball, 40))
# the first limit is too small for mesh.stl, the second one for mesh.obj
for size in (100_000, 5_000_000):
    limited(size, write_results, folder / 'result', cell, made, 'test', {})
"""


def output_of(code, folder):
    """Run code in a child process and return the lines that it prints."""
    environment = {**os.environ, 'PYTHONPATH': os.pathsep.join([str(ROOT), str(ROOT / 'test')])}
    done = subprocess.run(
        [sys.executable, '-c', _SETUP + code, str(folder)],
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return done.stdout.splitlines()


def listing(folder):
    return sorted(path.name for path in folder.iterdir())


def test_mesh_beyond_the_limit_is_named_and_the_earlier_file_remains(tmp_path):
    paths = [tmp_path / f'mesh.{suffix}' for suffix in ('stl', 'ply', 'obj', 'glb')]
    for path in paths:
        path.write_text('earlier')
    assert output_of(_MESHES, tmp_path) == [
        f'{path}: cannot be written: File too large' for path in paths
    ]
    assert all(path.read_text() == 'earlier' for path in paths)
    assert listing(tmp_path) == sorted(path.name for path in paths)


def test_results_beyond_the_limit_leave_no_folder(tmp_path):
    (tmp_path / 'earlier').mkdir()
    (tmp_path / 'earlier' / 'mesh.stl').write_text('earlier')
    stl, obj = output_of(_RESULTS, tmp_path)
    assert stl.endswith('mesh.stl: cannot be written: File too large')
    assert obj.endswith('mesh.obj: cannot be written: File too large')
    assert listing(tmp_path) == ['earlier']
    assert (tmp_path / 'earlier' / 'mesh.stl').read_text() == 'earlier'
