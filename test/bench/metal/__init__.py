# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Path-traced pictures of machined metal (Mitsuba 3), and what the extraction makes of them.

Parts, rigs and seeds are in two halves: ``DEVELOPMENT``, on which the constants of the extraction
were chosen, and ``HELD``, which only the bench reads. The pictures are rendered once and kept in
build/bench/metal.
"""
