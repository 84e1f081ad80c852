# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the node ``window`` is made of: requests to the cell, health of its nodes, pictures."""
