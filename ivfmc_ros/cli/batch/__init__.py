# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reconstruction of many bags: ``job`` is one, ``executors`` are processes or Dask."""
