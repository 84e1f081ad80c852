# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The recipe of a scan is kept in its folder, with the nominal."""

import pytest

from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import RecipeError
from ivfmc_ros.scan.recipe import load_recipe
from ivfmc_ros.scan.stored_recipe import load_stored_recipe
from ivfmc_ros.scan.stored_recipe import store_recipe


@pytest.fixture
def root(tmp_path):
    root = tmp_path / 'recipes'
    (root / 'cad').mkdir(parents=True)
    (root / 'cad' / 'part.stl').write_bytes(b'nominal')
    write(root)
    return root


@pytest.fixture
def scan(tmp_path):
    folder = tmp_path / 'scan'
    folder.mkdir()
    return folder


def write(root, tolerance=0.1, profiles=90):
    (root / 'fine.yaml').write_text(
        f'scan: {{profiles: {profiles}}}\n'
        f'inspection: {{nominal: cad/part.stl, tolerance: {tolerance}}}\n'
    )


def test_copy_stays_what_it_was_when_the_recipe_is_edited(root, scan):
    stored = store_recipe(load_recipe(root, 'fine'), root, scan)
    write(root, tolerance=5.0)
    (root / 'cad' / 'part.stl').write_bytes(b'another')
    again = load_stored_recipe(scan, 'fine')
    assert again == stored
    assert again.inspection.settings.tolerance == pytest.approx(1e-4)
    assert again.inspection.nominal.read_bytes() == b'nominal'
    assert again.inspection.nominal.is_relative_to(scan.resolve())


def test_recipe_without_an_inspection_is_copied_alone(root, scan):
    (root / 'fine.yaml').write_text('scan: {profiles: 90}')
    assert store_recipe(load_recipe(root, 'fine'), root, scan).inspection is None
    assert [path.name for path in (scan / 'recipe').iterdir()] == ['fine.yaml']


def test_scan_without_a_recipe_has_no_copy(scan):
    assert load_stored_recipe(scan, '') is None
    assert load_stored_recipe(scan, 'a name for the catalogue') is None


def test_recipe_that_changes_while_a_scan_is_accepted_is_refused(root, scan):
    recipe = load_recipe(root, 'fine')
    write(root, profiles=91)
    with pytest.raises(RecipeError, match=r'fine\.yaml: was changed while the scan was accepted'):
        store_recipe(recipe, root, scan)


def test_nominal_that_is_gone_is_named(root, scan):
    recipe = load_recipe(root, 'fine')
    (root / 'cad' / 'part.stl').unlink()
    with pytest.raises(FileError, match=r'part\.stl: cannot be copied to .*: No such file'):
        store_recipe(recipe, root, scan)
