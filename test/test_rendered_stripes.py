# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from support.rendered_stripes import Job
from support.rendered_stripes import render
from support.rendered_stripes import stripes_of
from support.synthetic import small_cell

from bench.pool import mapped
from ivfmc_ros.simulation.parts.solids import cylinder

JOB = Job(small_cell(), cylinder(0.02, 0.05), 0, np.array([0.0, 0.3]), 1)


def test_what_was_found_is_read_back(tmp_path):
    render(JOB, tmp_path)
    (file,) = tmp_path.iterdir()
    written = file.stat().st_mtime_ns
    stripes = stripes_of(JOB, tmp_path)
    assert file.stat().st_mtime_ns == written
    assert [len(stripe) > 50 for stripe in stripes] == [True, True]
    # a sheet through the axis shows a cylinder as a line, at every table angle the same
    means = [stripe.uv[:, 0].mean() for stripe in stripes]
    assert abs(means[0] - means[1]) < 0.5
    assert all(np.isfinite(stripe.sigma).all() for stripe in stripes)


def test_other_pictures_have_another_name():
    others = [JOB._replace(seed=2), JOB._replace(laser=1), JOB._replace(angles=np.array([0.0]))]
    assert len({job.name for job in (JOB, *others)}) == 4


def test_work_is_done_in_other_processes_in_order():
    assert mapped(abs, [-3, 2, -1]) == [3, 2, 1]
