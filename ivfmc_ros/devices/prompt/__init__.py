# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Motion controllers that answer each line with a prompt: ``ok`` (Marlin) or ``>`` (FabScan).

``prompt_line`` sends a line and collects the answer; ``controller`` is the common part of the
drivers, which differ in their commands.
"""
