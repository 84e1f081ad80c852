# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``python -m bench [GROUP ...]``, with ``test`` on the module path."""

import sys

from bench.runner import main

sys.exit(main())
