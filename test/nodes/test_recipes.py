# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A scan by a recipe: its values, its verdict, and recipes that are refused."""

import json

import pytest
import yaml

pytest.importorskip('rclpy')
from support.graph_rig import following_client
from support.graph_rig import running

from ivfmc_ros.meshing.io.export import write_solid
from ivfmc_ros.simulation.parts.solids import box
from ivfmc_ros.storage.catalogue.catalogue import Catalogue

PARAMETERS = {
    'part': 'thing',
    'recipe': '',
    'motion': 'step',
    'profiles': 5,
    'lasers': [''],
    'velocity': 20.0,
    'acceleration': 200.0,
}
RECIPES = {
    'plain': {'scan': {'profiles': 3}},
    'judged': {
        'part': 'block',
        'scan': {'profiles': 3, 'formats': ['stl']},
        'inspection': {'nominal': 'block.stl', 'tolerance': 0.1},
    },
    'wrong': {'scan': {'profile': 3}},
    'foreign': {'scan': {'lasers': ['top']}},
}


@pytest.fixture(scope='module')
def client():
    with following_client() as client:
        yield client


@pytest.fixture(scope='module')
def place(tmp_path_factory):
    place = tmp_path_factory.mktemp('cell')
    (place / 'recipes').mkdir()
    for name, document in RECIPES.items():
        (place / 'recipes' / f'{name}.yaml').write_text(yaml.safe_dump(document))
    solid = box((0.02, 0.03, 0.05))
    write_solid(place / 'recipes' / 'block.stl', solid.vertices_xyz, solid.faces)
    return place


@pytest.fixture(scope='module')
def orchestrator(client, cell_file, place):
    values = {
        'cell': str(cell_file),
        'scan_root': str(place / 'scans'),
        'recipe_root': str(place / 'recipes'),
    }
    with running('orchestrator', **values) as node:
        client.until(lambda: client.status, what='no scan_status')
        assert client.set('orchestrator', **PARAMETERS).successful
        yield node


def scan(client, recipe):
    assert client.set('orchestrator', recipe=recipe).successful
    return client.trigger('scan', 90.0)


def test_values_of_a_recipe_hold_for_its_scans_only(client, fake, orchestrator):
    success, answer = scan(client, 'plain')
    assert success, answer
    assert answer['parameters']['profiles'] == 3
    # what the recipe does not name is that of the parameters
    assert (answer['parameters']['part'], answer['parameters']['motion']) == ('thing', 'step')
    assert 'verdict' not in answer
    success, answer = scan(client, '')
    assert success, answer
    assert answer['parameters']['profiles'] == 5


def test_mesh_is_judged_and_the_verdict_is_told_everywhere(client, fake, orchestrator, place):
    success, answer = scan(client, 'judged')
    assert success, answer
    assert answer['parameters']['part'] == 'block'
    stored = place / 'scans' / answer['scan_id'] / 'recipe'
    assert {path.name for path in stored.iterdir()} == {'judged.yaml', 'block.stl'}
    # PLY states the uncertainty of the vertices
    assert answer['parameters']['formats'] == ['stl', 'ply']
    assert 'inspecting' in answer['seconds']
    # the fake mesher's mesh is another part, and states none
    assert answer['verdict'] == answer['inspection']['verdict']
    assert answer['verdict'] in ('no uncertainty known', 'not decided')
    assert answer['inspection'].get('reason') or answer['inspection'].get('notes')
    status = {item.key: item.value for item in client.status[-1].values}
    assert status['verdict'] == answer['verdict']
    report = json.loads((place / 'scans' / answer['scan_id'] / 'report.json').read_text())
    assert report['inspection'] == answer['inspection']
    row = Catalogue(place / 'scans').scan(answer['scan_id'])
    assert row.recipe == 'judged'
    if (place / 'scans' / answer['scan_id'] / 'inspection.json').exists():
        assert row.verdict == answer['verdict']


def test_nothing_is_decided_of_a_scan_that_is_not_ok(client, fake, orchestrator):
    table = {'code': 'SLIPPED', 'detail': 'the table slipped'}
    fake.responses['registrar/register'] = {'code': 'OK', 'table': table}
    success, answer = scan(client, 'judged')
    assert (success, answer['code']) == (False, 'SLIPPED')
    assert answer['verdict'] == 'not decided'
    assert 'SLIPPED' in answer['inspection']['reason']


@pytest.mark.parametrize(
    ('recipe', 'code', 'said'),
    [
        ('none', 'BAD_RECIPE', 'there are: foreign, judged, plain, wrong'),
        ('wrong', 'BAD_RECIPE', "unknown key 'profile'; did you mean 'profiles'?"),
        ('foreign', 'BAD_PARAMETER', "'top' is not in the cell"),
    ],
)
def test_recipe_that_cannot_be_used_starts_nothing(
    client, fake, orchestrator, place, recipe, code, said
):
    before = sorted((place / 'scans').iterdir()) if (place / 'scans').exists() else []
    success, answer = scan(client, recipe)
    assert (success, answer['code']) == (False, code)
    assert said in answer['detail']
    assert (sorted((place / 'scans').iterdir()) if before else before) == before
