# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Catalogue of the scans of a folder in SQLite, and its writer thread."""

from ivfmc_ros.storage.catalogue.catalogue import Catalogue as Catalogue
from ivfmc_ros.storage.catalogue.catalogue_writer import CatalogueWriter as CatalogueWriter
