# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Alembic migrations of the catalogue; ``upgrade.upgrade_schema`` runs them."""
