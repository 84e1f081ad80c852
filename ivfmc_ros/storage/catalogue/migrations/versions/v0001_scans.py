# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Version 1: scans, views, profiles and results of one cell, in SQLite.

A new catalogue goes through it as well; other databases begin with version 2.
"""

from alembic import op
import sqlalchemy as sql

revision = '0001'
down_revision = None
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Create the tables."""
    if op.get_context().dialect.name != 'sqlite':
        return
    op.create_table(
        'scans',
        sql.Column('scan_id', sql.String, primary_key=True),
        *(sql.Column(name, sql.String, nullable=False)
          for name in ('part', 'recipe', 'created', 'stage', 'code', 'folder', 'parameters')),
    )  # fmt: skip
    op.create_index('ix_scans_part', 'scans', ['part'])
    op.create_index('ix_scans_created', 'scans', ['created'])
    op.create_table(
        'views',
        sql.Column('scan_id', sql.String, sql.ForeignKey('scans.scan_id'), primary_key=True),
        sql.Column('view', sql.Integer, primary_key=True),
        *(sql.Column(name, sql.Integer, nullable=False)
          for name in ('laser', 'profiles', 'points')),
        *(sql.Column(name, sql.Float, nullable=False) for name in ('first_angle', 'last_angle')),
    )  # fmt: skip
    op.create_table(
        'profiles',
        sql.Column('scan_id', sql.String, sql.ForeignKey('scans.scan_id'), primary_key=True),
        sql.Column('seq', sql.Integer, primary_key=True),
        sql.Column('view', sql.Integer, nullable=False),
        sql.Column('laser', sql.Integer, nullable=False),
        sql.Column('angle', sql.Float, nullable=False),
        sql.Column('points', sql.Integer, nullable=False),
        sql.Column('stamp_ns', sql.BigInteger, nullable=False),
        sql.Column('topic', sql.String, nullable=False),
        sql.Column('message', sql.Integer, nullable=False),
        sql.Column('log_time_ns', sql.BigInteger, nullable=False),
        sql.Column('chunk_offset', sql.BigInteger, nullable=False),
    )
    op.create_table(
        'results',
        sql.Column('scan_id', sql.String, sql.ForeignKey('scans.scan_id'), primary_key=True),
        sql.Column('number', sql.Integer, primary_key=True),
        *(sql.Column(name, sql.String, nullable=False)
          for name in ('created', 'folder', 'summary')),
    )  # fmt: skip


def downgrade() -> None:
    """There is no earlier version."""
    raise NotImplementedError('the catalogue has no version before 0001')
