# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Results that a job leaves in its process for the next one."""

import numpy as np
import pytest

from ivfmc_ros import pipeline
from ivfmc_ros.errors import GeometryError
from ivfmc_ros.errors import ScanError
from ivfmc_ros.meshing.settings import MeshSettings
from ivfmc_ros.model import Mesh
from ivfmc_ros.nodes.processing import worker_jobs

SETTINGS = pipeline.Settings()
OTHER = pipeline.Settings(mesh=MeshSettings(smoothing=1))


@pytest.fixture
def made(monkeypatch):
    """Return the settings of every mesh that was made."""
    found = []
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float) * 0.02
    mesh = Mesh(
        vertices_xyz=corners,
        faces=np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
        normals=np.full_like(corners, np.nan),
        sigma=np.full(4, 2e-5),
        intensity=np.full(4, 100.0),
    )

    def mesh_views(cell, views, poses, settings):
        found.append(settings)
        return mesh, settings.mesh

    monkeypatch.setattr(pipeline, 'mesh_views', mesh_views)
    monkeypatch.setattr(worker_jobs, '_kept', worker_jobs._Kept())
    return found


def build(folder, key, settings=SETTINGS):
    output = worker_jobs.MeshOutput(folder=str(folder), suffixes=['stl'], triangles=100)
    return worker_jobs.build(None, [], None, settings, output, key)


def test_prepared_mesh_is_written_and_not_made_again(made, tmp_path):
    worker_jobs.prepare((1, SETTINGS), None, [], None, SETTINGS)
    assert not list(tmp_path.iterdir())
    answer = build(tmp_path, (1, SETTINGS))
    assert made == [SETTINGS]
    assert answer.counts['faces'] == 4
    assert set(answer.seconds) == {'meshing', 'files'}
    assert (tmp_path / 'mesh.stl').is_file()
    # it is kept for one build
    build(tmp_path / 'again', (1, SETTINGS))
    assert len(made) == 2


@pytest.mark.parametrize('key', [(2, SETTINGS), (1, OTHER), None])
def test_mesh_of_other_views_or_settings_is_made_anew(made, tmp_path, key):
    worker_jobs.prepare((1, SETTINGS), None, [], None, SETTINGS)
    build(tmp_path, key, OTHER)
    assert made == [SETTINGS, OTHER]


def test_build_reports_the_error_of_its_mesh(made, monkeypatch, tmp_path):
    def fail(*_):
        raise GeometryError('no surface')

    monkeypatch.setattr(pipeline, 'mesh_views', fail)
    for work in (
        lambda: worker_jobs.prepare((1, SETTINGS), None, [], None, SETTINGS),
        lambda: build(tmp_path, (1, SETTINGS)),
    ):
        with pytest.raises(GeometryError, match='no surface'):
            work()


def test_check_without_registered_views_is_refused(made):
    with pytest.raises(ScanError, match='register them again'):
        worker_jobs.check()
