# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
from datetime import datetime
from datetime import UTC

import numpy as np
import pytest
from support.synthetic import small_camera
from support.synthetic import small_cell
import yaml

from ivfmc_ros.cell.cell_file import CellDraft
from ivfmc_ros.cell.cell_file import load_cell
from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.cell.cell_file import save_draft
from ivfmc_ros.cell.laser import Bow
from ivfmc_ros.errors import CellError
from ivfmc_ros.errors import FileError

# by hand: the camera looks level at the table from 0.4 m, the sheet crosses at 45 degrees
CELL = """\
version: 1
camera_frame: camera_optical_frame
turntable:
  joint: turntable_joint
  camera_from_base: [0, 1, 0, 0,
                     0, 0, -1, 0.05,
                     -1, 0, 0, 0.4,
                     0, 0, 0, 1]
  residual_rms: 0.00004        # meters
lasers:
  - name: left
    plane: [0.8, 0.0, -0.6, 0.24]     # |n| = 1 and n.X + d = 0
    residual_rms: 5e-5
    stripe: rows
created: 2026-11-23T10:00:00Z
"""
MATRIX = CELL[CELL.index('[0, 1') : CELL.index('  residual')]


@pytest.fixture
def cell_yaml(tmp_path):
    """Return a function that writes the file with a piece of its text replaced."""

    def write(old='', new=''):
        assert old in CELL
        path = tmp_path / 'cell.yaml'
        path.write_text(CELL.replace(old, new, 1) if old else CELL)
        return path

    return write


def test_cell_of_the_contract_is_read(cell_yaml):
    cell = load_cell(cell_yaml(), small_camera())
    assert cell.camera_frame == 'camera_optical_frame'
    assert cell.turntable.joint == 'turntable_joint'
    assert cell.turntable.residual_rms == 4e-5
    assert np.array_equal(
        cell.turntable.camera_from_base,
        [[0, 1, 0, 0], [0, 0, -1, 0.05], [-1, 0, 0, 0.4], [0, 0, 0, 1]],
    )
    (laser,) = cell.lasers
    assert (laser.name, laser.stripe, laser.offset) == ('left', 'rows', 0.24)
    assert np.array_equal(laser.normal, [0.8, 0.0, -0.6])


def test_number_that_yaml_takes_for_a_text_is_read(cell_yaml):
    assert yaml.safe_load(CELL)['lasers'][0]['residual_rms'] == '5e-5'
    assert load_draft(cell_yaml()).lasers[0].residual_rms == 5e-5


@pytest.mark.parametrize(
    'text', ['2026-11-23T10:00:00Z', "'2026-11-23T10:00:00Z'", '2026-11-23T12:00:00+02:00']
)
def test_time_is_read_quoted_or_not(cell_yaml, text):
    created = load_draft(cell_yaml('2026-11-23T10:00:00Z', text)).created
    assert datetime.fromisoformat(created) == datetime(2026, 11, 23, 10, tzinfo=UTC)


def test_optional_keys_are_read(cell_yaml):
    extra = 'covariance: [' + ', '.join(str(k) for k in range(16)) + ']'
    extra += '\n    volume: [-0.1, -0.1, 0.3, 0.1, 0.1, 0.5]'
    extra += '\n    thickness: 0.0003'
    path = cell_yaml('stripe: rows', f'stripe: columns\n    {extra}')
    path.write_text(path.read_text() + 'temperature_c: 21.5\nboard: {kind: chessboard}\n')
    draft = load_draft(path)
    assert draft.lasers[0].stripe == 'columns'
    assert draft.lasers[0].covariance[1].tolist() == [4, 5, 6, 7]
    assert draft.lasers[0].volume.tolist() == [[-0.1, -0.1, 0.3], [0.1, 0.1, 0.5]]
    assert draft.lasers[0].thickness == 0.0003
    assert draft.notes == {'temperature_c': 21.5, 'board': {'kind': 'chessboard'}}


def test_cell_is_read_as_written(tmp_path):
    rng = np.random.default_rng(1)
    cell = small_cell()
    left, right = cell.lasers
    along = np.cross(left.normal, [0.0, 1.0, 0.0])
    bow = Bow(
        center=-left.offset * left.normal,
        along=along / np.linalg.norm(along),
        coefficients=rng.normal(size=3),
    )
    cell = replace(
        cell,
        turntable=replace(
            cell.turntable,
            covariance=rng.normal(size=(6, 6)),
            residual_rms=1e-5,
            trigger_step=0.01,
        ),
        lasers=(
            replace(left, bow=bow, covariance=rng.normal(size=(4, 4)), residual_rms=1 / 30000),
            replace(right, volume=rng.normal(size=(2, 3)), stripe='columns', thickness=2e-4),
        ),
        camera_frame='eye',
        notes={'board': {'kind': 'charuco', 'square_m': 0.03}, 'temperature_c': 20.5},
    )
    save_cell(tmp_path / 'cell.yaml', cell)
    loaded = load_cell(tmp_path / 'cell.yaml', cell.camera)
    assert facts(loaded) == facts(cell)


def facts(cell):
    """All that a file holds, comparable."""
    values = [cell.camera_frame, dict(cell.notes), cell.turntable.joint]
    values += [cell.turntable.camera_from_base.tolist(), cell.turntable.residual_rms]
    values.append(cell.turntable.trigger_step)
    values += [None if cell.turntable.covariance is None else cell.turntable.covariance.tolist()]
    for laser in cell.lasers:
        values += [laser.name, laser.stripe, laser.offset, laser.residual_rms]
        values.append(laser.thickness)
        arrays = [laser.normal, laser.covariance, laser.volume]
        if laser.bow is not None:
            arrays += [laser.bow.center, laser.bow.along, laser.bow.coefficients]
        values += [None if array is None else array.tolist() for array in arrays]
    return values


def test_time_of_an_unchanged_draft_is_kept(cell_yaml, tmp_path):
    draft = load_draft(cell_yaml())
    save_draft(tmp_path / 'again.yaml', draft)
    assert load_draft(tmp_path / 'again.yaml').created == '2026-11-23T10:00:00Z'


def test_changed_draft_is_dated_anew(cell_yaml, tmp_path):
    draft = load_draft(cell_yaml())
    save_draft(tmp_path / 'again.yaml', draft.with_laser(replace(draft.lasers[0], name='right')))
    created = datetime.fromisoformat(load_draft(tmp_path / 'again.yaml').created)
    assert abs((datetime.now(UTC) - created).total_seconds()) < 60.0


def test_calibrations_complete_a_cell_one_by_one(tmp_path):
    cell = small_cell()
    path = tmp_path / 'cell.yaml'
    save_draft(path, CellDraft())
    save_draft(path, load_draft(path).with_laser(cell.lasers[1]))
    save_draft(path, load_draft(path).with_turntable(cell.turntable))
    save_draft(path, load_draft(path).with_laser(cell.lasers[0]))
    better = replace(cell.lasers[1], residual_rms=1e-6)
    save_draft(path, load_draft(path).with_laser(better).with_notes(exposure=4000))
    loaded = load_cell(path, cell.camera)
    assert [laser.name for laser in loaded.lasers] == ['right', 'left']
    assert loaded.lasers[0].residual_rms == 1e-6
    assert loaded.notes == {'exposure': 4000}


def test_cell_without_turntable_says_which_command_finds_it(cell_yaml):
    whole = CELL[CELL.index('turntable:') : CELL.index('lasers:')]
    path = cell_yaml(whole, '')
    assert load_draft(path).turntable is None
    with pytest.raises(CellError, match=r"cell\.yaml: turntable: .* 'ivfmc calibrate turntable'"):
        load_cell(path, small_camera())


@pytest.mark.parametrize('lasers', ['', 'lasers: []\n', 'lasers:\n'])
def test_cell_without_laser_says_which_command_finds_it(cell_yaml, lasers):
    path = cell_yaml(CELL[CELL.index('lasers:') : CELL.index('created')], lasers)
    with pytest.raises(CellError, match=r"cell\.yaml: lasers: .* 'ivfmc calibrate laser'"):
        load_cell(path, small_camera())


@pytest.mark.parametrize(
    ('old', 'new', 'problem'),
    [
        ('version: 1', 'version: 2', 'version: 2 is not 1'),
        ('version: 1\n', '', 'version: is missing'),
        ('camera_frame: camera_optical_frame\n', '', 'camera_frame: is missing'),
        ('camera_frame: camera_optical_frame', 'camera_frame: 3', 'camera_frame: must be a text'),
        ('created:', 'unit: mm\ncreated:', "unknown key 'unit'"),
        ('  joint:', '  axis: z\n  joint:', "turntable: unknown key 'axis'"),
        ('    stripe', '    colour: red\n    stripe', r"lasers\[0\]: unknown key 'colour'"),
        ('  joint: turntable_joint\n', '', 'turntable: joint: is missing'),
        ('  residual_rms: 0.00004', '  residual_rms: low', 'turntable: residual_rms: .low. is no'),
        ('    residual_rms: 5e-5\n', '', r'lasers\[0\]: residual_rms: is missing'),
        ('stripe: rows', 'stripe: diagonal', r"lasers\[0\]: stripe: 'diagonal' is neither rows"),
        ('  - name: left', '  - name:', r'lasers\[0\]: name: must be a text'),
        ('plane: [0.8, 0.0,', 'plane: [0.8,', r'lasers\[0\]: plane: must be a list of 4'),
        ('plane: [0.8', 'plane: [.nan', r'lasers\[0\]: plane: nan is not a finite'),
        ('plane: [0.8', 'plane: [0.9', r'lasers\[0\]: plane: the normal .* length 1'),
        ('0.24]', '0.0]', r'lasers\[0\]: plane: the camera center lies in the laser plane'),
        ('created: 2026-11-23T10:00:00Z', 'created: today', 'created: must be an ISO 8601'),
        ('turntable:', 'turntable: 3\nrest:', 'unknown key .rest.'),
        ('lasers:', 'lasers: left\nboard:', 'lasers: must be a list'),
        ('lasers:\n', 'lasers:\n  - left\n', r'lasers\[0\]: must be a mapping'),
        ('    stripe', '    covariance: [1, 2]\n    stripe', 'covariance: must be a list of 16'),
        ('    stripe', '    bow: {center: [0, 0, 0]}\n    stripe', 'bow: along: is missing'),
        ('version: 1', 'version: [1', 'is not YAML'),
    ],
)
def test_file_and_key_of_what_is_wrong_are_named(cell_yaml, old, new, problem):
    with pytest.raises(CellError, match=rf'cell\.yaml: .*{problem}|cell\.yaml: {problem}'):
        load_draft(cell_yaml(old, new))


@pytest.mark.parametrize(
    ('matrix', 'problem'),
    [
        ('[0, -1, 0, 0,  0, 0, -1, 0.05,  -1, 0, 0, 0.4,  0, 0, 0, 1]', 'reflected'),
        ('[0, 1, 0, 0,  0, 0, -1, 0.05,  -1.001, 0, 0, 0.4,  0, 0, 0, 1]', 'not orthonormal'),
        ('[0, 1, 0, 0,  0, 0, -1, 0.05,  -1, 0, 0, -0.4,  0, 0, 0, 1]', 'behind the camera'),
        ('[0, 1, 0, 0,  0, 0, -1, 0.05,  -1, 0, 0, 0.4,  0, 0, 0, 0]', 'the last row'),
        ('[0, 1, 0, 0,  0, 0, -1, .nan,  -1, 0, 0, 0.4,  0, 0, 0, 1]', 'nan is not a finite'),
        ('[0, 1, 0, 0,  0, 0, -1, 0.05,  -1, 0, 0, 0.4]', 'must be a list of 16'),
        ('[[0, 1, 0, 0],  [0, 0, -1, 0.05],  [-1, 0, 0, 0.4],  [0, 0, 0, 1]]', 'list of 16'),
    ],
)
def test_impossible_turntable_is_refused(cell_yaml, matrix, problem):
    with pytest.raises(CellError, match=rf'cell\.yaml: turntable: camera_from_base: .*{problem}'):
        load_draft(cell_yaml(MATRIX, matrix + '\n'))


def test_plane_that_the_camera_cannot_see_is_refused(cell_yaml):
    path = cell_yaml('[0.8, 0.0, -0.6, 0.24]', '[0.0, 0.0, 1.0, 0.4]')
    with pytest.raises(CellError, match=r'cell\.yaml: lasers: left: plane: the camera cannot'):
        load_cell(path, small_camera())


def test_two_lasers_of_one_name_are_refused(cell_yaml):
    laser = CELL[CELL.index('  - name') : CELL.index('created')]
    path = cell_yaml(laser, laser + laser)
    with pytest.raises(CellError, match=r'cell\.yaml: lasers: two have the same name'):
        load_cell(path, small_camera())


def test_missing_file_is_named(tmp_path):
    with pytest.raises(CellError, match=r'none\.yaml: cannot be read: No such file'):
        load_draft(tmp_path / 'none.yaml')


def test_empty_file_is_refused(tmp_path):
    (tmp_path / 'cell.yaml').write_text('')
    with pytest.raises(CellError, match=r'cell\.yaml: must be a mapping'):
        load_draft(tmp_path / 'cell.yaml')


def test_note_that_could_not_be_read_back_is_refused():
    with pytest.raises(ValueError, match="'bord' is no note of a cell"):
        CellDraft().with_notes(bord='chessboard')


def test_folder_that_is_missing_is_named(tmp_path):
    with pytest.raises(FileError, match=r'none.cell\.yaml: cannot be written'):
        save_cell(tmp_path / 'none' / 'cell.yaml', small_cell())


def test_new_turntable_keeps_joint_and_trigger_which_are_wiring():
    table = small_cell().turntable
    before = CellDraft(turntable=replace(table, joint='axis_c', trigger_step=0.01))
    after = before.with_turntable(table).turntable
    assert (after.joint, after.trigger_step) == ('axis_c', 0.01)
    other = replace(table, trigger_step=0.02)
    assert before.with_turntable(other).turntable.trigger_step == 0.02
    assert CellDraft().with_turntable(table).turntable.trigger_step == 0.0


@pytest.mark.parametrize('step', [-0.01, 0.2, float('nan')])
def test_trigger_step_out_of_range_is_refused(step):
    with pytest.raises(CellError, match='trigger_step'):
        replace(small_cell().turntable, trigger_step=step)
