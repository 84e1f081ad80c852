# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Removes the rows of profiles that a power cut took from the end of a bag."""

import sqlalchemy as sql

from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.catalogue.schema import PROFILES
from ivfmc_ros.storage.catalogue.schema import VIEWS


def remove_lost_profiles(catalogue: Catalogue, scan_id: str, first: int) -> None:
    """
    Remove the rows of the profiles of a scan from seq ``first`` on; its views are counted anew.

    :raises CatalogueError: the scan does not exist
    """
    key = catalogue.scan(scan_id).key
    lost = PROFILES.c.scan == key, PROFILES.c.seq >= first
    with catalogue.database.write() as connection:
        views = set(connection.execute(sql.select(PROFILES.c.view).where(*lost)).scalars())
        connection.execute(sql.delete(PROFILES).where(*lost))
        connection.execute(sql.delete(VIEWS).where(VIEWS.c.scan == key, VIEWS.c.view.in_(views)))
        of_views = PROFILES.c.scan == key, PROFILES.c.view.in_(views)
        kept = set(connection.execute(sql.select(PROFILES.c.view).where(*of_views)).scalars())
        for view in sorted(kept):
            catalogue.update_view(connection, key, view)
