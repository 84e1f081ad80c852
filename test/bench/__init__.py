# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Figures of the scanner, each measured against a bar.

A group is a module ``bench_<group>.py`` in this folder with ``run()``, which returns or yields
``Number`` objects. ``make bench`` runs all groups, ``make bench NAME=<group>`` one.
"""

from bench.number import at_least
from bench.number import at_most
from bench.number import Bar
from bench.number import Number

__all__ = ['Bar', 'Number', 'at_least', 'at_most']
