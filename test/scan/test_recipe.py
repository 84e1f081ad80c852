# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recipes are read as their schema says, and errors name the file and the key."""

import json

from jsonschema import Draft202012Validator
import pytest
from support.house import ROOT
import yaml

from ivfmc_ros.errors import RecipeError
from ivfmc_ros.inspection.section_plane import MIDDLE_PLANES
from ivfmc_ros.inspection.section_plane import SectionPlane
from ivfmc_ros.scan.recipe import load_recipe
from ivfmc_ros.scan.recipe import recipe_names
from ivfmc_ros.scan.recipe import SCAN_KEYS

SCHEMA = json.loads((ROOT / 'config' / 'schemas' / 'recipe-1.json').read_text(encoding='utf-8'))
WHOLE = {
    'version': 1,
    'part': 'bracket',
    'description': 'The bracket of the demo',
    'scan': {'profiles': 400, 'lasers': ['left'], 'overlap': 0.2, 'formats': ['stl']},
    'inspection': {
        'nominal': 'cad/bracket.stl',
        'unit': 'inch',
        'tolerance': 0.1,
        'features': {'cylinder 3': {'diameter': 0.05}, 'plane 1': 0.2},
        'align': 'datum',
        'datums': ['plane 1', 'cylinder 2'],
        'sections': ['z=12.5', 'x'],
        'temperature': 23.5,
    },
}


@pytest.fixture
def root(tmp_path):
    (tmp_path / 'cad').mkdir()
    (tmp_path / 'cad' / 'bracket.stl').write_text('')
    return tmp_path


def load(root, document, name='bracket'):
    text = document if isinstance(document, str) else yaml.safe_dump(document)
    (root / f'{name}.yaml').write_text(text, encoding='utf-8')
    return load_recipe(root, name)


def changed(section, **values):
    return {**WHOLE, section: {**WHOLE[section], **values}}


def test_whole_recipe_is_read(root):
    found = load(root, WHOLE)
    assert found.part == 'bracket'
    assert found.scan == {
        'profiles': 400, 'lasers': ('left',), 'overlap': 0.2, 'formats': ('stl',),
    }  # fmt: skip
    plan = found.inspection
    assert plan.nominal == (root / 'cad' / 'bracket.stl').resolve()
    assert (plan.unit, plan.datums) == ('inch', ('plane 1', 'cylinder 2'))
    assert plan.settings.tolerance == pytest.approx(1e-4)
    assert plan.settings.features['cylinder 3'] == {'diameter': pytest.approx(5e-5)}
    assert plan.settings.conditions.temperature == 23.5
    assert plan.settings.sections == (SectionPlane('z', 0.0125), SectionPlane('x'))
    assert recipe_names(root) == ['bracket']


def test_empty_recipe_changes_nothing(root):
    found = load(root, {'description': 'as the cell is set'})
    assert (found.part, found.scan, found.inspection) == ('', {}, None)


def test_sections_of_a_recipe_are_three_unless_it_says_none(root):
    without = {k: v for k, v in WHOLE['inspection'].items() if k != 'sections'}
    found = load(root, {**WHOLE, 'inspection': without})
    assert found.inspection.settings.sections == MIDDLE_PLANES
    assert load(root, changed('inspection', sections=[])).inspection.settings.sections == ()


@pytest.mark.parametrize(
    ('document', 'said'),
    [
        ({**WHOLE, 'version': 2}, 'version: 2 is not known'),
        ({**WHOLE, 'scans': {}}, "unknown key 'scans'"),
        ({**WHOLE, 'part': '../x'}, "part: '../x' is not a valid name"),
        (changed('scan', profile=5), "scan: unknown key 'profile'; did you mean 'profiles'?"),
        (changed('scan', profiles='many'), "scan: profiles: 'many' must be a whole number"),
        (changed('scan', profiles=True), 'scan: profiles: True must be a whole number'),
        (changed('scan', profiles=1), 'scan: profiles'),
        (changed('scan', overlap='wide'), "scan: overlap: 'wide' is not a finite number"),
        (changed('scan', lasers='left'), 'scan: lasers: must be a list of names'),
        (changed('scan', exposures=0.002), 'scan: exposures: must be a list of seconds'),
        (changed('scan', exposures=['2ms']), 'scan: exposures: must be a list of seconds'),
        (changed('scan', exposures=[0.008, 0.002]), 'exposures: must ascend'),
        (changed('scan', dark_frames='no'), "scan: dark_frames: 'no' must be true or false"),
        (changed('scan', part='other'), "scan: unknown key 'part'"),
        (changed('scan', motion='fast'), 'scan: motion'),
        (changed('scan', max_gap=0.1), 'scan: max_gap'),
        (changed('inspection', tolerance=-1), 'inspection: tolerance'),
        (changed('inspection', nominal='/etc/passwd'), "nominal: '/etc/passwd' is not below"),
        (changed('inspection', nominal='../other.stl'), "nominal: '../other.stl' is not below"),
        (changed('inspection', nominal='cad/none.stl'), 'none.stl: file not found'),
        (changed('inspection', unit='ell'), 'inspection: unit'),
        (changed('inspection', align='best'), 'inspection: align'),
        (changed('inspection', align='best_fit'), 'datums: belong to align: datum'),
        (changed('inspection', features={'plane 1': {'width': 1}}), "'width' is not one of"),
        (changed('inspection', temperature=900), 'inspection: temperature'),
        (changed('inspection', sections='z=1'), 'inspection: sections: must be a list'),
        (changed('inspection', sections=['w=1']), "inspection: section: 'w=1' is not understood"),
        (changed('inspection', sections=['x', 'x']), "inspection: section: 'x' is given twice"),
        ({**WHOLE, 'scan': [1]}, 'scan: must be a mapping'),
        ('{', 'not YAML'),
        ('text', 'must be a mapping'),
    ],
)
def test_invalid_recipe_is_refused_by_file_and_key(root, document, said):
    with pytest.raises(RecipeError) as caught:
        load(root, document)
    assert said in str(caught.value)
    assert str(caught.value).startswith(str(root / 'bracket.yaml'))


def test_name_that_is_no_recipe_is_refused_with_those_there_are(root):
    load(root, WHOLE)
    with pytest.raises(RecipeError, match='there are: bracket'):
        load_recipe(root, 'brackets')
    with pytest.raises(RecipeError, match='is not a valid name'):
        load_recipe(root, '../bracket')
    with pytest.raises(RecipeError, match='is no folder of recipes'):
        load_recipe(root / 'none', 'bracket')


def test_schema_has_the_keys_that_are_read():
    Draft202012Validator.check_schema(SCHEMA)
    assert set(SCHEMA['properties']['scan']['properties']) == set(SCAN_KEYS)
    Draft202012Validator(SCHEMA).validate(WHOLE)


@pytest.mark.parametrize(
    'document',
    [
        changed('scan', profiles='many'),
        changed('scan', motion='fast'),
        changed('scan', profile=5),
        changed('inspection', tolerance=-1),
        changed('inspection', unit='ell'),
        changed('inspection', features={'plane 1': {'width': 1}}),
        {**WHOLE, 'version': 2},
    ],
)
def test_schema_refuses_what_the_reader_refuses(document):
    assert not Draft202012Validator(SCHEMA).is_valid(document)
