# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from collections import Counter

import pytest
from support.batch_work import Task
from support.batch_work import work

from ivfmc_ros.cli.batch.executors import run_in_processes
from ivfmc_ros.cli.batch.executors import run_on_cluster
from ivfmc_ros.errors import HelperError


def test_process_that_dies_costs_its_own_job_only(tmp_path):
    tasks = [Task(str(number), tmp_path / 'log', dies=number == 1) for number in range(4)]
    outcomes = list(run_in_processes(tasks, 2, work))
    assert len(outcomes) == 4
    assert sorted(outcome for outcome in outcomes if isinstance(outcome, str)) == ['0', '2', '3']
    [died] = [outcome for outcome in outcomes if not isinstance(outcome, str)]
    assert (died.name, died.code) == ('1', 'NODE_DIED')
    # it was tried again, but not for ever
    assert 1 < Counter((tmp_path / 'log').read_text().split())['1'] <= 3


def test_jobs_run_on_a_cluster(tmp_path):
    distributed = pytest.importorskip('distributed', reason='Dask is not installed')
    tasks = [Task(str(number), tmp_path / 'log') for number in range(4)]
    options = {'n_workers': 1, 'threads_per_worker': 1, 'processes': False}
    with distributed.LocalCluster(**options, protocol='tcp', dashboard_address=':0') as cluster:
        outcomes = list(run_on_cluster(tasks, cluster.scheduler_address, work))
    assert sorted(outcomes) == ['0', '1', '2', '3']
    assert sorted((tmp_path / 'log').read_text().split()) == ['0', '1', '2', '3']


def test_cluster_that_does_not_answer_is_named(monkeypatch):
    pytest.importorskip('distributed', reason='Dask is not installed')
    monkeypatch.setattr('ivfmc_ros.cli.batch.executors._CONNECT_S', 1)
    with pytest.raises(HelperError, match='no Dask scheduler answers'):
        list(run_on_cluster([], 'tcp://127.0.0.1:1', work))
