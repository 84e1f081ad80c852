# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The service resume with an interrupted scan, at a cell of fake nodes."""

import json

import pytest
from support.graph_rig import following_client
from support.graph_rig import running
from support.recordings import write_profiles
from support.synthetic import small_cell

from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.meshing.io.export import write_solid
from ivfmc_ros.scan import scan_folder
from ivfmc_ros.scan.plan import make_plan
from ivfmc_ros.scan.plan import MotionLimits
from ivfmc_ros.scan.request import ScanRequest
from ivfmc_ros.scan.resume import CAN_RESUME
from ivfmc_ros.scan.resume import COURSE
from ivfmc_ros.scan.resume import Course
from ivfmc_ros.scan.stored_recipe import RECIPE_FOLDER
from ivfmc_ros.scan.view_coverage import CompletenessLimits
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.storage.catalogue.catalogue import Catalogue

SCAN = '20261128T101500Z_part'
ZERO = 'life-7'
LASER = small_cell().lasers[0].name


@pytest.fixture
def client():
    with following_client() as client:
        yield client


@pytest.fixture
def root(tmp_path):
    """Folder with a scan in steps that was interrupted behind two profiles."""
    root = tmp_path / 'scans'
    request = ScanRequest(motion='step', profiles=5, lasers=(LASER,), closure=0.0)
    motion = MotionLimits(velocity=20.0, acceleration=200.0)
    plan = make_plan(request, [laser.name for laser in small_cell().lasers], motion)
    course = Course(
        plan=plan,
        motion=motion,
        limits=CompletenessLimits(),
        tolerance=2e-3,
        patience=20.0,
        begun=plan.sweeps,
        zero=ZERO,
    )
    write_profiles(root / SCAN, range(2), per_chunk=1, finish=False)
    save_cell(root / SCAN / 'cell.yaml', small_cell())
    document = {'stage': 'FAILED', 'code': 'INTERRUPTED', 'detail': '', CAN_RESUME: True}
    document |= {'request': request.as_dict(), COURSE: course.as_dict()}
    scan_folder.save_job(root / SCAN, document)
    Catalogue(root, create=True).add_scan(SCAN, 'part', '', 'FAILED', request.as_dict())
    return root


@pytest.fixture
def orchestrator(client, fake, cell_file, root):
    values = {'cell': str(cell_file), 'scan_root': str(root), 'heartbeat_limit': 10.0}
    with running('orchestrator', **values) as node:
        client.until(lambda: client.status, what='no scan_status')
        yield node


def values_of(client):
    return {item.key: item.value for item in client.status[-1].values}


def refused(client, code, text):
    success, answer = client.trigger('resume')
    assert (success, answer['code']) == (False, code)
    assert text in answer['detail']


def test_interrupted_scan_goes_on_with_what_is_missing(client, fake, orchestrator, root):
    fake.say_zero(ZERO)
    assert client.set('orchestrator', resume_scan=SCAN).successful
    success, answer = client.trigger('resume')
    assert success, answer
    assert (answer['scan_id'], answer['resumed'], answer['profiles']) == (SCAN, True, 2)
    success, busy = client.trigger('resume')
    assert (success, busy['code']) == (False, 'WRONG_STATE')
    client.until(lambda: values_of(client)['result'], 60.0, 'no end')
    result = json.loads(values_of(client)['result'])
    assert (result['code'], result['resumed']) == ('OK', True), result
    assert fake.called[:3] == ['registrar/reset', 'recorder/start', 'registrar/load']
    assert 'turntable/home' not in fake.called
    for name in ('triangulator', 'registrar', 'recorder'):
        assert fake.parameter(name, 'first_profile') == 2
    # all of them, or the mesh would be of the new part alone
    assert fake.parameter('registrar', 'expected') == result['counts']['profiles'] > 5
    (view,) = result['completeness']['views']
    assert (view['missing_deg'], view['retaken_as']) == ([], [1])
    assert Catalogue(root).scan(SCAN).stage == 'DONE'
    assert scan_folder.load_job(root / SCAN)[COURSE]['parts'] == [0, 2]
    refused(client, 'RESUME_REFUSED', 'was not interrupted: it is DONE')
    # the next scan begins at profile 0
    client.set('orchestrator', motion='step', profiles=3, velocity=20.0, acceleration=200.0)
    assert client.trigger('scan', 60.0)[1]['resumed'] is False
    assert fake.parameter('triangulator', 'first_profile') == 0


def test_resumed_scan_is_judged_by_the_recipe_with_which_it_began(
    client, fake, orchestrator, root
):
    """The orchestrator was started again without a folder of recipes."""
    job = scan_folder.load_job(root / SCAN)
    job['request'] |= {'recipe': 'judged', 'formats': ['ply']}
    scan_folder.save_job(root / SCAN, job)
    copy = root / SCAN / RECIPE_FOLDER
    copy.mkdir()
    solid = box((0.02, 0.03, 0.05))
    write_solid(copy / 'block.stl', solid.vertices_xyz, solid.faces)
    (copy / 'judged.yaml').write_text('inspection: {nominal: block.stl, tolerance: 0.1}')
    fake.say_zero(ZERO)
    client.set('orchestrator', resume_scan=SCAN)
    success, answer = client.trigger('resume')
    assert success, answer
    client.until(lambda: values_of(client)['result'], 60.0, 'no end')
    result = json.loads(values_of(client)['result'])
    assert result['inspection']['recipe'] == 'judged', result
    assert result['verdict'] in ('no uncertainty known', 'not decided')


def test_scan_that_cannot_be_resumed_is_refused_by_name_and_stays(
    client, fake, orchestrator, root, cell_file
):
    refused(client, 'WRONG_STATE', f'set the parameter resume_scan to its id, such as {SCAN}')
    for name in ('../scans', '/etc/passwd', '..'):
        result = client.set('orchestrator', resume_scan=name)
        assert not result.successful
        assert 'is not the id of a scan' in result.reason
    client.set('orchestrator', resume_scan='unknown')
    refused(
        client,
        'RESUME_REFUSED',
        f"has no scan 'unknown'; the last one that can be resumed is {SCAN}",
    )
    client.set('orchestrator', resume_scan=SCAN)
    fake.say_zero('another')
    client.spin(0.2)
    refused(client, 'RESUME_REFUSED', 'the zero of the table is not the one')
    part = root / SCAN / 'scan.mcap.part'
    data = part.read_bytes()
    part.unlink()
    refused(client, 'BAD_BAG', 'there is no such file')
    part.write_bytes(data)
    assert scan_folder.load_job(root / SCAN)[CAN_RESUME] is True
    assert not fake.called
    # one that fails before its first sweep can be tried again
    fake.say_zero(ZERO)
    client.spin(0.2)
    fake.responses['recorder/start'] = {'code': 'BAD_BAG', 'detail': 'has 1 profiles'}
    assert client.trigger('resume')[0]
    client.until(lambda: values_of(client)['code'] == 'BAD_BAG', 60.0, 'no end')
    job = scan_folder.load_job(root / SCAN)
    assert (job['stage'], job['code'], job[CAN_RESUME]) == ('FAILED', 'BAD_BAG', True)
