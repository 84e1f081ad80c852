# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
import json

import pytest
from support.recordings import write_profiles
from support.synthetic import small_cell

from ivfmc_ros.cell.camera_file import save_camera
from ivfmc_ros.cell.cell_file import CellDraft
from ivfmc_ros.cell.cell_file import load_draft
from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.cell.cell_file import save_draft
from ivfmc_ros.errors import BagError
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import ResumeError
from ivfmc_ros.scan import scan_folder
from ivfmc_ros.scan.plan import make_plan
from ivfmc_ros.scan.plan import MotionLimits
from ivfmc_ros.scan.request import ScanRequest
from ivfmc_ros.scan.resume import CAN_RESUME
from ivfmc_ros.scan.resume import COURSE
from ivfmc_ros.scan.resume import Course
from ivfmc_ros.scan.resume import last_interrupted
from ivfmc_ros.scan.resume import load_interrupted
from ivfmc_ros.scan.resume import require_scan_id
from ivfmc_ros.scan.view_coverage import CompletenessLimits

REQUEST = ScanRequest(profiles=80)
PLAN = make_plan(REQUEST, ('left', 'right'), MotionLimits())
# The scan was not homed, and had begun its first sweep.
COURSE_NOW = Course(
    plan=PLAN,
    motion=MotionLimits(),
    limits=CompletenessLimits(max_gap=5.0),
    tolerance=3e-3,
    patience=45.0,
    begun=PLAN.sweeps[:1],
    parts=(0, 4, 9),
    zero='life-3',
)


def write_job(folder, course=COURSE_NOW, **changes):
    document = {
        'stage': 'FAILED', 'code': 'INTERRUPTED', 'request': REQUEST.as_dict(),
        CAN_RESUME: True, COURSE: course.as_dict(), **changes,
    }  # fmt: skip
    scan_folder.save_job(folder, document)


@pytest.fixture
def cell(tmp_path):
    save_cell(tmp_path / 'cell.yaml', small_cell())
    return tmp_path / 'cell.yaml'


@pytest.fixture
def folder(tmp_path, cell):
    """Folder of a scan with 7 profiles, the last of them not in a whole chunk."""
    made = tmp_path / 'scans' / 'interrupted'
    write_profiles(made, range(8), per_chunk=7, finish=False)
    write_job(made)
    save_cell(made / 'cell.yaml', small_cell())
    save_camera(made / 'camera.yaml', small_cell().camera)
    return made


def test_interrupted_scan_is_loaded_with_the_profiles_of_its_bag(folder, cell):
    found = load_interrupted(folder, cell)
    assert (found.request, found.course.limits.max_gap) == (REQUEST, 5.0)
    # not those of the node that goes on
    assert (found.course.tolerance, found.course.patience) == (3e-3, 45.0)
    assert (found.course.plan, found.planned) == (PLAN, PLAN.sweeps[:1])
    assert (found.first_profile, sorted(found.headers)) == (7, list(range(7)))
    # a part that lost its profiles by a power cut is none
    assert found.course.parts == (0, 4, 7)
    assert not found.is_taken
    found.require_camera(small_cell().camera)
    assert last_interrupted(folder.parent) == 'interrupted'


def test_sweep_without_a_profile_has_not_begun(folder, cell):
    write_job(folder, replace(COURSE_NOW, begun=PLAN.sweeps))
    # the profiles are of views 0 and 1
    assert load_interrupted(folder, cell).planned == PLAN.sweeps
    write_profiles(folder / 'short', range(4), per_chunk=4, finish=False)
    (folder / 'short' / 'scan.mcap.part').replace(folder / 'scan.mcap.part')
    assert load_interrupted(folder, cell).planned == PLAN.sweeps[:1]


def test_zero_of_the_table_has_to_be_the_same_or_found_by_homing(folder, cell):
    found = load_interrupted(folder, cell)
    assert found.needs_homing('life-3') is False
    for zero, text in (('life-4', 'is not the one'), ('', 'does not say')):
        with pytest.raises(ResumeError, match=f'interrupted: the .*{text}.*ivfmc reconstruct'):
            found.needs_homing(zero)
    write_job(folder, replace(COURSE_NOW, home=True))
    found = load_interrupted(folder, cell)
    assert [found.needs_homing(zero) for zero in ('life-3', 'life-4', '')] == [False, True, True]


def test_scan_without_a_known_zero_is_not_resumed_by_an_unknown_one(folder, cell):
    write_job(folder, replace(COURSE_NOW, zero=''))
    with pytest.raises(ResumeError, match='does not say whether its zero is still the same'):
        load_interrupted(folder, cell).needs_homing('')


@pytest.mark.parametrize(
    ('changes', 'text'),
    [
        ({'stage': 'DONE', 'code': 'OK'}, 'was not interrupted: it is DONE'),
        ({'stage': 'CANCELLED', 'code': 'CANCELLED'}, 'it is CANCELLED'),
        ({'stage': 'SCANNING', 'code': ''}, 'was not interrupted: it runs'),
        ({'code': 'SLIPPED', CAN_RESUME: False}, 'ended with SLIPPED, and cannot go on'),
    ],
)
def test_scan_that_was_not_interrupted_is_refused(folder, cell, changes, text):
    write_job(folder, **changes)
    with pytest.raises(ResumeError, match=text):
        load_interrupted(folder, cell)
    assert last_interrupted(folder.parent) == ''


def test_scan_of_an_earlier_version_or_with_a_mesh_is_refused(folder, cell):
    (folder / 'mesh.stl').touch()
    with pytest.raises(ResumeError, match=r'mesh.stl: exists already'):
        load_interrupted(folder, cell)
    scan_folder.save_job(folder, {'stage': 'FAILED', 'code': 'INTERRUPTED'})
    with pytest.raises(ResumeError, match='was taken by an earlier version'):
        load_interrupted(folder, cell)
    with pytest.raises(ResumeError, match='there is no such scan'):
        load_interrupted(folder / 'unknown', cell)


def test_scan_of_another_calibration_is_refused(folder, cell):
    draft = load_draft(cell)
    laser = replace(draft.lasers[0], offset=draft.lasers[0].offset + 1e-5)
    save_draft(cell, CellDraft(turntable=draft.turntable, lasers=(laser, *draft.lasers[1:])))
    with pytest.raises(ResumeError, match='began with another calibration'):
        load_interrupted(folder, cell)


def test_camera_of_another_calibration_is_refused(folder, cell):
    found = load_interrupted(folder, cell)
    camera = small_cell().camera
    K = camera.K.copy()
    K[0, 0] += 1e-3
    with pytest.raises(ResumeError, match=r'camera.yaml: the camera has another calibration'):
        found.require_camera(replace(camera, K=K))


def test_bag_that_is_gone_empty_or_damaged_is_refused(folder, cell):
    part = folder / 'scan.mcap.part'
    data = part.read_bytes()
    part.write_bytes(data[:40])
    with pytest.raises(ResumeError, match='no profile is in its bag'):
        load_interrupted(folder, cell)
    part.write_bytes(data[:200] + b'\xff' * 50 + data[250:] + data[8:])
    with pytest.raises(BagError, match='is damaged at byte'):
        load_interrupted(folder, cell)
    part.unlink()
    with pytest.raises(BagError, match='there is no such file'):
        load_interrupted(folder, cell)


@pytest.mark.parametrize(
    'change',
    [
        {COURSE: None},
        {COURSE: {**COURSE_NOW.as_dict(), 'plan': []}},
        {COURSE: {**COURSE_NOW.as_dict(), 'parts': [3, 0]}},
        {COURSE: {**COURSE_NOW.as_dict(), 'begun': [{'number': 'x'}]}},
        {COURSE: {**COURSE_NOW.as_dict(), 'motion': {'velocity': -1.0}}},
        {'request': {'part': '../x'}},
        {'request': 'none'},
    ],
)
def test_job_file_that_is_none_of_a_scan_is_refused(folder, cell, change):
    job = {**scan_folder.load_job(folder), **change}
    (folder / 'job.json').write_text(json.dumps(job))
    with pytest.raises(FileError, match=r'job.json: is not that of a scan'):
        load_interrupted(folder, cell)


def write_with_recipe(folder, **parameters):
    write_job(folder, request={**REQUEST.as_dict(), 'recipe': 'fine'})
    scan_folder.save_parameters(folder, {'recipe': 'fine', **parameters})


def test_scan_goes_on_with_the_recipe_with_which_it_began(folder, cell):
    write_with_recipe(folder, recipe_root='recipes')
    (folder / 'recipe').mkdir()
    (folder / 'recipe' / 'fine.yaml').write_text('part: shaft')
    assert load_interrupted(folder, cell).recipe.part == 'shaft'


def test_scan_is_not_resumed_without_the_recipe_that_would_judge_it(folder, cell):
    write_with_recipe(folder, recipe_root='recipes')
    with pytest.raises(ResumeError, match='recipe: has no recipe fine, with which the scan began'):
        load_interrupted(folder, cell)
    (folder / 'recipe').mkdir()
    (folder / 'recipe' / 'fine.yaml').write_text('parts: shaft')
    with pytest.raises(ResumeError, match=r"interrupted: .*fine.yaml: .*unknown key 'parts'"):
        load_interrupted(folder, cell)


def test_name_of_a_recipe_for_the_catalogue_needs_no_copy(folder, cell):
    write_with_recipe(folder, recipe_root='')
    assert load_interrupted(folder, cell).recipe is None


@pytest.mark.parametrize('name', ['../scans', '/etc', 'a/b', '..', 'a..b', '.hidden', '-x', 'a b'])
def test_id_that_is_a_path_is_refused(name):
    with pytest.raises(ParameterError, match='is not the id of a scan'):
        require_scan_id(name)


def test_id_of_a_part_with_a_long_name_is_one():
    name = '20261128T101500Z_' + 63 * 'p' + '_12'
    assert require_scan_id(name) == name
