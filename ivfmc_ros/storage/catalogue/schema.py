# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Tables of the catalogue, as the newest migration leaves them.

A test compares them with the migrations. Times are ISO 8601 in UTC with milliseconds, which sort
as text; angles are radians, lengths meters.
"""

import sqlalchemy as sql

METADATA = sql.MetaData()


def _name_table(name: str) -> sql.Table:
    return sql.Table(
        name,
        METADATA,
        sql.Column('id', sql.Integer, primary_key=True),
        sql.Column('name', sql.String, nullable=False, unique=True),
    )


CELLS = _name_table('cells')
PARTS = _name_table('parts')
RECIPES = _name_table('recipes')
CALIBRATIONS = sql.Table(
    'calibrations',
    METADATA,
    sql.Column('id', sql.Integer, primary_key=True),
    sql.Column('cell', sql.Integer, sql.ForeignKey('cells.id'), nullable=False),
    sql.Column('sha256', sql.String, nullable=False),  # of cell.yaml
    sql.Column('created', sql.String, nullable=False),
    sql.Column('document', sql.Text, nullable=False),  # cell.yaml
    sql.UniqueConstraint('cell', 'sha256', name='uq_calibrations'),
)
CERTIFICATES = sql.Table(
    'certificates',
    METADATA,
    sql.Column('id', sql.Integer, primary_key=True),
    sql.Column(
        'calibration', sql.Integer, sql.ForeignKey('calibrations.id'), nullable=False, index=True
    ),
    sql.Column('created', sql.String, nullable=False),
    sql.Column('verdict', sql.String, nullable=False),
    sql.Column('document', sql.Text, nullable=False),  # JSON
)
SCANS = sql.Table(
    'scans',
    METADATA,
    sql.Column('id', sql.Integer, primary_key=True),
    sql.Column('scan_id', sql.String, nullable=False, index=True),
    sql.Column('cell', sql.Integer, sql.ForeignKey('cells.id'), nullable=False),
    sql.Column('part', sql.Integer, sql.ForeignKey('parts.id'), nullable=False),
    sql.Column('recipe', sql.Integer, sql.ForeignKey('recipes.id'), nullable=False),
    sql.Column('calibration', sql.Integer, sql.ForeignKey('calibrations.id')),
    sql.Column('created', sql.String, nullable=False, index=True),
    sql.Column('stage', sql.String, nullable=False),
    sql.Column('code', sql.String, nullable=False),
    sql.Column('verdict', sql.String, nullable=False),  # of the last inspection, '' without one
    sql.Column('folder', sql.String, nullable=False),  # relative to the folder of the scans
    sql.Column('parameters', sql.Text, nullable=False),  # JSON
    sql.Column('deleted', sql.String, nullable=False),  # time, '' for a scan that is not
    sql.UniqueConstraint('cell', 'scan_id', name='uq_scans'),
    sql.Index('ix_scans_part_created', 'part', 'created'),
    sql.Index('ix_scans_cell_created', 'cell', 'created'),
    sql.Index('ix_scans_verdict_created', 'verdict', 'created'),
)
VIEWS = sql.Table(
    'views',
    METADATA,
    sql.Column('scan', sql.Integer, sql.ForeignKey('scans.id'), primary_key=True),
    sql.Column('view', sql.Integer, primary_key=True),
    sql.Column('laser', sql.Integer, nullable=False),
    sql.Column('profiles', sql.Integer, nullable=False),
    sql.Column('points', sql.Integer, nullable=False),
    sql.Column('first_angle', sql.Float, nullable=False),
    sql.Column('last_angle', sql.Float, nullable=False),
)
PROFILES = sql.Table(
    'profiles',
    METADATA,
    sql.Column('scan', sql.Integer, sql.ForeignKey('scans.id'), primary_key=True),
    sql.Column('seq', sql.Integer, primary_key=True),
    sql.Column('view', sql.Integer, nullable=False),
    sql.Column('laser', sql.Integer, nullable=False),
    sql.Column('angle', sql.Float, nullable=False),
    sql.Column('speed', sql.Float, nullable=False),
    sql.Column('points', sql.Integer, nullable=False),
    sql.Column('stamp_ns', sql.BigInteger, nullable=False),
    sql.Column('topic', sql.String, nullable=False),
    sql.Column('message', sql.Integer, nullable=False),  # index in the topic, from 0
    sql.Column('log_time_ns', sql.BigInteger, nullable=False),
    sql.Column('chunk_offset', sql.BigInteger, nullable=False),
)
RESULTS = sql.Table(
    'results',
    METADATA,
    sql.Column('scan', sql.Integer, sql.ForeignKey('scans.id'), primary_key=True),
    sql.Column('number', sql.Integer, primary_key=True),
    sql.Column('created', sql.String, nullable=False),
    sql.Column('folder', sql.String, nullable=False),
    sql.Column('summary', sql.Text, nullable=False),  # JSON
)
VERDICTS = sql.Table(
    'verdicts',
    METADATA,
    sql.Column('scan', sql.Integer, sql.ForeignKey('scans.id'), primary_key=True),
    sql.Column('number', sql.Integer, primary_key=True),
    sql.Column('created', sql.String, nullable=False),
    sql.Column('verdict', sql.String, nullable=False),
    sql.Column('nominal', sql.String, nullable=False),  # CAD model
    sql.Column('sha256', sql.String, nullable=False),  # of the report
)
FEATURES = sql.Table(
    'features',
    METADATA,
    sql.Column('scan', sql.Integer, primary_key=True),
    sql.Column('number', sql.Integer, primary_key=True),  # of the verdict
    sql.Column('feature', sql.String, primary_key=True),
    sql.Column('characteristic', sql.String, primary_key=True),
    sql.Column('nominal', sql.Float),
    sql.Column('measured', sql.Float),
    sql.Column('uncertainty', sql.Float),  # expanded, k = 2
    sql.Column('tolerance', sql.Float),
    sql.Column('verdict', sql.String, nullable=False),
    sql.ForeignKeyConstraint(['scan', 'number'], ['verdicts.scan', 'verdicts.number']),
    sql.Index('ix_features_feature', 'feature', 'characteristic'),
)
# Tables with rows of a scan, those first that refer to others.
OF_A_SCAN = (FEATURES, VERDICTS, RESULTS, PROFILES, VIEWS)
