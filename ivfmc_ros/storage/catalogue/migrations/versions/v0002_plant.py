# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Version 2: cells, parts, recipes, calibrations, certificates, verdicts and measured features.

A scan has its cell, so that many cells can use one database. The rows of version 1 are kept; its
scans are of the cell that has no name.
"""

from alembic import op
import sqlalchemy as sql

revision = '0002'
down_revision = '0001'
branch_labels = None
depends_on = None

# Name of the cell of the scans of version 1.
_CELL = 'cell'
_OLD = ('results', 'profiles', 'views', 'scans')


def upgrade() -> None:
    """Create the new tables and copy the rows of version 1."""
    is_sqlite = op.get_context().dialect.name == 'sqlite'
    if is_sqlite:
        for index in ('ix_scans_part', 'ix_scans_created'):
            op.drop_index(index, 'scans')
        for table in _OLD:
            op.rename_table(table, f'old_{table}')
    for name in ('cells', 'parts', 'recipes'):
        op.create_table(
            name,
            sql.Column('id', sql.Integer, primary_key=True),
            sql.Column('name', sql.String, nullable=False, unique=True),
        )
    _create_calibrations()
    _create_scans()
    _create_rows_of_scans()
    _create_inspections()
    if is_sqlite:
        _copy_version_1()
        for table in _OLD:
            op.drop_table(f'old_{table}')


def downgrade() -> None:
    """Refuse: version 1 has no place for what version 2 holds."""
    raise NotImplementedError('a catalogue of version 0002 cannot become one of version 0001')


def _create_calibrations() -> None:
    op.create_table(
        'calibrations',
        sql.Column('id', sql.Integer, primary_key=True),
        sql.Column('cell', sql.Integer, sql.ForeignKey('cells.id'), nullable=False),
        sql.Column('sha256', sql.String, nullable=False),
        sql.Column('created', sql.String, nullable=False),
        sql.Column('document', sql.Text, nullable=False),
        sql.UniqueConstraint('cell', 'sha256', name='uq_calibrations'),
    )
    op.create_table(
        'certificates',
        sql.Column('id', sql.Integer, primary_key=True),
        sql.Column('calibration', sql.Integer, sql.ForeignKey('calibrations.id'), nullable=False),
        sql.Column('created', sql.String, nullable=False),
        sql.Column('verdict', sql.String, nullable=False),
        sql.Column('document', sql.Text, nullable=False),
    )
    op.create_index('ix_certificates_calibration', 'certificates', ['calibration'])


def _create_scans() -> None:
    op.create_table(
        'scans',
        sql.Column('id', sql.Integer, primary_key=True),
        sql.Column('scan_id', sql.String, nullable=False),
        sql.Column('cell', sql.Integer, sql.ForeignKey('cells.id'), nullable=False),
        sql.Column('part', sql.Integer, sql.ForeignKey('parts.id'), nullable=False),
        sql.Column('recipe', sql.Integer, sql.ForeignKey('recipes.id'), nullable=False),
        sql.Column('calibration', sql.Integer, sql.ForeignKey('calibrations.id')),
        *(sql.Column(name, sql.String, nullable=False)
          for name in ('created', 'stage', 'code', 'verdict', 'folder')),
        sql.Column('parameters', sql.Text, nullable=False),
        sql.Column('deleted', sql.String, nullable=False),
        sql.UniqueConstraint('cell', 'scan_id', name='uq_scans'),
    )  # fmt: skip
    op.create_index('ix_scans_scan_id', 'scans', ['scan_id'])
    op.create_index('ix_scans_created', 'scans', ['created'])
    for first in ('part', 'cell', 'verdict'):
        op.create_index(f'ix_scans_{first}_created', 'scans', [first, 'created'])


def _create_rows_of_scans() -> None:
    op.create_table(
        'views',
        sql.Column('scan', sql.Integer, sql.ForeignKey('scans.id'), primary_key=True),
        sql.Column('view', sql.Integer, primary_key=True),
        *(sql.Column(name, sql.Integer, nullable=False)
          for name in ('laser', 'profiles', 'points')),
        *(sql.Column(name, sql.Float, nullable=False) for name in ('first_angle', 'last_angle')),
    )  # fmt: skip
    op.create_table(
        'profiles',
        sql.Column('scan', sql.Integer, sql.ForeignKey('scans.id'), primary_key=True),
        sql.Column('seq', sql.Integer, primary_key=True),
        sql.Column('view', sql.Integer, nullable=False),
        sql.Column('laser', sql.Integer, nullable=False),
        sql.Column('angle', sql.Float, nullable=False),
        sql.Column('speed', sql.Float, nullable=False),
        sql.Column('points', sql.Integer, nullable=False),
        sql.Column('stamp_ns', sql.BigInteger, nullable=False),
        sql.Column('topic', sql.String, nullable=False),
        sql.Column('message', sql.Integer, nullable=False),
        sql.Column('log_time_ns', sql.BigInteger, nullable=False),
        sql.Column('chunk_offset', sql.BigInteger, nullable=False),
    )
    op.create_table(
        'results',
        sql.Column('scan', sql.Integer, sql.ForeignKey('scans.id'), primary_key=True),
        sql.Column('number', sql.Integer, primary_key=True),
        sql.Column('created', sql.String, nullable=False),
        sql.Column('folder', sql.String, nullable=False),
        sql.Column('summary', sql.Text, nullable=False),
    )


def _create_inspections() -> None:
    op.create_table(
        'verdicts',
        sql.Column('scan', sql.Integer, sql.ForeignKey('scans.id'), primary_key=True),
        sql.Column('number', sql.Integer, primary_key=True),
        *(sql.Column(name, sql.String, nullable=False)
          for name in ('created', 'verdict', 'nominal', 'sha256')),
    )  # fmt: skip
    op.create_table(
        'features',
        sql.Column('scan', sql.Integer, primary_key=True),
        sql.Column('number', sql.Integer, primary_key=True),
        sql.Column('feature', sql.String, primary_key=True),
        sql.Column('characteristic', sql.String, primary_key=True),
        *(sql.Column(name, sql.Float)
          for name in ('nominal', 'measured', 'uncertainty', 'tolerance')),
        sql.Column('verdict', sql.String, nullable=False),
        sql.ForeignKeyConstraint(['scan', 'number'], ['verdicts.scan', 'verdicts.number']),
    )  # fmt: skip
    op.create_index('ix_features_feature', 'features', ['feature', 'characteristic'])


def _copy_version_1() -> None:
    op.execute(sql.text('INSERT INTO cells (name) VALUES (:cell)').bindparams(cell=_CELL))
    for table, column in (('parts', 'part'), ('recipes', 'recipe')):
        op.execute(f'INSERT INTO {table} (name) SELECT DISTINCT {column} FROM old_scans')
    op.execute(
        'INSERT INTO scans (scan_id, cell, part, recipe, created, stage, code, verdict, folder, '
        "parameters, deleted) SELECT o.scan_id, c.id, p.id, r.id, o.created, o.stage, o.code, '', "
        "o.folder, o.parameters, '' FROM old_scans o JOIN cells c ON 1 = 1 "
        'JOIN parts p ON p.name = o.part JOIN recipes r ON r.name = o.recipe'
    )
    columns = {
        'views': 'view, laser, profiles, points, first_angle, last_angle',
        'profiles': 'seq, view, laser, angle, points, stamp_ns, topic, message, log_time_ns, '
        'chunk_offset',
        'results': 'number, created, folder, summary',
    }
    for table, names in columns.items():
        # version 1 did not store the speed of a profile
        more, values = (', speed', ', 0.0') if table == 'profiles' else ('', '')
        listed = ', '.join(f'o.{name.strip()}' for name in names.split(','))
        op.execute(
            f'INSERT INTO {table} (scan, {names}{more}) SELECT s.id, {listed}{values} '
            f'FROM old_{table} o JOIN scans s ON s.scan_id = o.scan_id'
        )
