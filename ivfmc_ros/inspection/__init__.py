# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Inspection of a mesh against a nominal mesh: deviations, fitted shapes, uncertainty, verdicts.

``inspect.inspect`` is the entry point; ``reports`` writes the results as JSON, HTML and images.
"""
