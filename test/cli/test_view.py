# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import http.client
import re
import signal
import subprocess
import sys

from click.testing import CliRunner
import numpy as np
import pytest

from ivfmc_ros.cli.main import ivfmc
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.meshing.io.export import write_mesh
from ivfmc_ros.model import Mesh
from ivfmc_ros.simulation.parts.solids import demo_part


@pytest.fixture
def stl(tmp_path):
    solid = demo_part()
    path = tmp_path / 'part.stl'
    count = len(solid.vertices_xyz)
    mesh = Mesh(
        vertices_xyz=solid.vertices_xyz,
        faces=solid.faces,
        normals=np.full((count, 3), np.nan),
        sigma=np.full(count, 2e-5),
        intensity=np.full(count, 100.0),
    )
    write_mesh(path, mesh, 'mm')
    return path


def refused(*arguments):
    result = CliRunner().invoke(ivfmc, ['view', *map(str, arguments), '--no-browser'])
    assert isinstance(result.exception, ScanError), result.output
    return result.exception


def test_mesh_is_served_until_ctrl_c(stl):
    command = [sys.executable, '-m', 'ivfmc_ros.cli.main', 'view', str(stl), '--no-browser']
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        line = process.stdout.readline()
        port = int(re.search(r'127\.0\.0\.1:(\d+)', line)[1])
        connection = http.client.HTTPConnection('127.0.0.1', port, timeout=10)
        connection.request('GET', '/')
        assert connection.getresponse().status == 200
        connection.close()
    finally:
        process.send_signal(signal.SIGINT)
        code = process.wait(30)
    assert code == 0


def test_missing_file_is_named(tmp_path):
    error = refused(tmp_path / 'none')
    assert isinstance(error, FileError)
    assert 'none: file not found' in str(error)


def test_folder_that_is_no_scan_is_refused(tmp_path):
    assert str(tmp_path) in str(refused(tmp_path))


def test_nominal_needs_a_mesh(tmp_path, stl):
    (tmp_path / 'bag').mkdir()
    error = refused(tmp_path / 'bag', '--nominal', stl)
    assert isinstance(error, FileError | ParameterError)
