# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from contextlib import closing
import json
import sqlite3
import zipfile

import cv2
import pytest
from support.recordings import write_profiles

from ivfmc_ros.errors import CatalogueError
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError
from ivfmc_ros.errors import StateError
from ivfmc_ros.storage.bag.reader import open_bag
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.scans.stored_scan import read_profiles

FIRST = '20261125T100000Z_bracket'
LAST = '20261127T100000Z_bracket'


def flip(path):
    data = bytearray(path.read_bytes())
    # in the second of four chunks
    data[data.index(b'\x04\0\0\0zstd', data.index(b'\x04\0\0\0zstd') + 1) + 40] ^= 1
    path.write_bytes(bytes(data))


def test_scans_are_found_by_part_date_and_verdict(recorded, command):
    def found(*options):
        answer = command('list', '--scans', recorded, '--json', *options)
        assert answer.exit_code == 0, answer.output
        return [row['scan_id'] for row in json.loads(answer.output)]

    assert len(found()) == 3
    assert found('--since', '2026-11-26') == found()[1:]
    assert found('--until', '2026-11-26T10:00:00+00:00') == [FIRST]
    assert found('--part', 'flange') == []
    assert len(found('--verdict', 'pass', '--code', 'OK')) == 3
    assert found('--newest', '1') == [LAST]
    assert found('--cell', 'other') == []


def test_measured_feature_is_listed_as_table_json_and_csv(recorded, command):
    options = '--scans', recorded, '--feature', 'hole 3'
    assert '10.0100' in command('list', *options).output
    rows = json.loads(command('list', *options, '--json').output)
    assert [row['measured_m'] for row in rows] == [10.01e-3, 10.02e-3, 9.99e-3]
    head, first, *_ = command('list', *options, '--csv').output.splitlines()
    values = dict(zip(head.split(','), first.split(','), strict=True))
    assert (values['feature'], values['measured_m']) == ('hole 3', '0.01001')
    assert command('list', *options, '--characteristic', 'position', '--json').output == '[]\n'


def test_date_that_is_none_is_named(recorded, command):
    answer = command('list', '--scans', recorded, '--since', 'yesterday')
    assert answer.exit_code == 2
    assert "'yesterday' is neither a date such as" in answer.output


def test_statistics_are_computed_and_drawn(recorded, command, tmp_path):
    chart = tmp_path / 'chart.png'
    options = '--scans', recorded, '--part', 'bracket', '--feature', 'hole 3'
    found = json.loads(command('statistics', *options, '-o', chart, '--json').output)
    # moving ranges 0.01 and 0.03 mm: sigma 0.02 mm / 1.128
    assert found['sigma'] == pytest.approx(0.02e-3 / 1.128)
    assert found['cp'] == pytest.approx(0.1e-3 / (6 * 0.02e-3 / 1.128))
    mean = sum((10.01e-3, 10.02e-3, 9.99e-3)) / 3
    assert found['cpk'] == pytest.approx((10.05e-3 - mean) / (3 * 0.02e-3 / 1.128))
    assert cv2.imread(str(chart)).std() > 5.0
    assert 'say little' in command('statistics', *options).output


def test_statistics_need_a_part_and_a_feature(recorded, command):
    answer = command('statistics', '--scans', recorded, '--part', 'bracket')
    assert isinstance(answer.exception, ParameterError)


def test_damaged_scan_is_found_repaired_and_read_again(recorded, command):
    flip(recorded / FIRST / 'scan.mcap')
    answer = command('verify', '--scans', recorded)
    assert answer.exit_code == 3
    assert 'missing: profiles 3 to 5 (view 0 or 1, table angle 17.19 deg to 28.65 deg)' in (
        answer.output
    )
    assert f'{LAST}: sound, complete' in answer.output
    answer = command('repair', FIRST, '--scans', recorded)
    assert answer.exit_code == 0, answer.exception
    assert (recorded / FIRST / 'scan.mcap.damaged').exists()
    profiles = list(read_profiles(Catalogue(recorded), FIRST))
    assert [profile.seq for profile in profiles] == [0, 1, 2, *range(6, 12)]
    assert profiles[3].points_xyz[0, 0] == pytest.approx(600.0)
    # what the catalogue knew of the lost profiles is still said
    again = command('verify', FIRST, '--scans', recorded)
    assert again.exit_code == 3
    assert 'sound, incomplete' in again.output
    assert 'missing: profiles 3 to 5 (view 0 or 1' in again.output


def test_sound_scans_pass(recorded, command):
    answer = command('verify', '--scans', recorded, '--json')
    assert answer.exit_code == 0
    assert [row['sound'] and row['complete'] for row in json.loads(answer.output)] == [True] * 3


def test_deleted_scan_can_be_restored_until_the_trash_is_emptied(recorded, command):
    options = '--scans', recorded
    assert command('delete', FIRST, *options, input='n\n').exit_code == 1
    assert (recorded / FIRST).is_dir()
    assert command('delete', FIRST, *options, input='y\n').exit_code == 0
    assert not (recorded / FIRST).exists()
    assert FIRST not in command('list', *options).output
    assert FIRST in command('list', '--trash', *options).output
    assert isinstance(command('delete', FIRST, '--yes', *options).exception, StateError)
    assert command('restore', FIRST, *options).exit_code == 0
    assert open_bag(recorded / FIRST).message_count == 12
    assert FIRST in command('list', *options).output
    command('delete', FIRST, '--yes', *options)
    assert command('empty-trash', '--yes', *options).exit_code == 0
    assert isinstance(command('restore', FIRST, *options).exception, CatalogueError)
    assert not (recorded / '.trash' / FIRST).exists()


@pytest.mark.parametrize('folder', ['../victim', '{victim}', '', '.', '.trash/../../victim'])
@pytest.mark.parametrize('action', ['empty-trash', 'delete'])
def test_folder_outside_of_the_scans_is_not_deleted(recorded, command, folder, action):
    victim = recorded.parent / 'victim'
    victim.mkdir()
    (victim / 'file').write_text('x')
    named = folder.format(victim=victim)
    with closing(sqlite3.connect(recorded / 'catalogue.sqlite3')) as database:
        deleted = '2026-11-27' if action == 'empty-trash' else ''
        change = 'UPDATE scans SET folder = ?, deleted = ? WHERE scan_id = ?'
        database.execute(change, (named, deleted, FIRST))
        database.commit()
    words = ['empty-trash'] if action == 'empty-trash' else ['delete', FIRST]
    answer = command(*words, '--yes', '--scans', recorded)
    assert isinstance(answer.exception, CatalogueError)
    assert f"{FIRST}': its folder {named!r}" in str(answer.exception)
    assert (victim / 'file').exists()
    assert (recorded / FIRST).is_dir()


def test_cell_whose_name_leaves_the_folder_is_refused(recorded):
    with closing(sqlite3.connect(recorded / 'catalogue.sqlite3')) as database:
        database.execute("UPDATE cells SET name = '../other'")
        database.commit()
    catalogue = Catalogue(recorded)
    # as on a machine that has the scans of all cells of a plant
    catalogue.root = recorded.parent / '{cell}'
    with pytest.raises(CatalogueError, match=r"of cell '\.\./other' is not below"):
        catalogue.scan(FIRST)


def test_rebuild_of_a_folder_elsewhere_is_refused(recorded, command):
    answer = command('rebuild', f'../{recorded.name}/{FIRST}', '--scans', recorded)
    assert isinstance(answer.exception, FileError)
    assert 'is not the name of a folder in' in str(answer.exception)


def test_running_scan_is_not_deleted(recorded, command):
    Catalogue(recorded).set_stage(FIRST, 'SCANNING')
    answer = command('delete', FIRST, '--yes', '--scans', recorded)
    assert isinstance(answer.exception, StateError)
    assert (recorded / FIRST).is_dir()


def test_catalogue_is_rebuilt_from_the_bags_alone(recorded, command):
    before = command('list', '--scans', recorded, '--feature', 'hole 3', '--json').output
    (recorded / 'catalogue.sqlite3').write_bytes(b'not a database at all' * 100)
    answer = command('rebuild', '--scans', recorded)
    assert answer.exit_code == 0, answer.exception
    assert (recorded / 'catalogue.sqlite3.damaged').exists()
    after = command('list', '--scans', recorded, '--feature', 'hole 3', '--json').output
    assert json.loads(after) == json.loads(before)
    assert len(list(read_profiles(Catalogue(recorded), FIRST))) == 12
    # a second time changes nothing
    command('rebuild', '--scans', recorded)
    assert command('list', '--scans', recorded, '--feature', 'hole 3', '--json').output == after


def test_scan_without_a_profile_is_rebuilt(recorded, command):
    # it ended before the first one
    write_profiles(recorded / 'empty', [], per_chunk=1)
    answer = command('rebuild', '--scans', recorded, '--json')
    assert answer.exit_code == 0, answer.exception
    counts = {row['scan_id']: row['profiles'] for row in json.loads(answer.stdout)}
    assert (counts['empty'], counts[FIRST]) == (0, 12)


def test_scan_goes_to_another_machine_as_one_file(recorded, command, tmp_path):
    package, other = tmp_path / 'scan.zip', tmp_path / 'other'
    assert command('export', FIRST, '--scans', recorded, '-o', package).exit_code == 0
    answer = command('import', package, '--scans', other)
    assert answer.exit_code == 0, answer.exception
    for name in ('scan.mcap', 'metadata.yaml', 'inspection/report.json'):
        assert (other / FIRST / name).read_bytes() == (recorded / FIRST / name).read_bytes()
    scan = Catalogue(other).scan(FIRST)
    assert (scan.code, scan.verdict, scan.created) == ('OK', 'pass', '2026-11-25T10:00:00.000Z')
    assert len(list(read_profiles(Catalogue(other), FIRST))) == 12
    assert isinstance(command('import', package, '--scans', other).exception, FileError)
    assert isinstance(
        command('export', FIRST, '--scans', recorded, '-o', package).exception, FileError
    )


def test_scan_in_the_trash_is_not_imported_over(recorded, command, tmp_path):
    package = tmp_path / 'scan.zip'
    command('export', FIRST, '--scans', recorded, '-o', package)
    command('delete', FIRST, '--yes', '--scans', recorded)
    answer = command('import', package, '--scans', recorded)
    assert isinstance(answer.exception, FileError)
    assert f'{FIRST}: is in the trash' in str(answer.exception)
    assert command('restore', FIRST, '--scans', recorded).exit_code == 0


def rewritten(package, target, change):
    """Copy a package with one entry changed."""
    with zipfile.ZipFile(package) as source, zipfile.ZipFile(target, 'w') as copy:
        for name in source.namelist():
            change(copy, name, source.read(name))
    return target


def test_changed_package_is_refused_and_nothing_remains(recorded, command, tmp_path):
    package, other = tmp_path / 'scan.zip', tmp_path / 'other'
    command('export', FIRST, '--scans', recorded, '-o', package)

    def flipped(copy, name, data):
        copy.writestr(name, data[:-1] + b'\0' if name == 'scan.mcap' else data)

    changed = rewritten(package, tmp_path / 'changed.zip', flipped)
    answer = command('import', changed, '--scans', other)
    assert 'scan.mcap: differs from its hash' in str(answer.exception)
    assert not (other / FIRST).exists()


@pytest.mark.parametrize('evil', ['../evil', '/evil', 'a/../../evil', '..\\evil'])
def test_package_that_leaves_the_folder_is_refused(recorded, command, tmp_path, evil):
    package, other = tmp_path / 'scan.zip', tmp_path / 'other'
    command('export', FIRST, '--scans', recorded, '-o', package)

    def renamed(copy, name, data):
        text = data.replace(b'inspection/report.json', evil.encode().replace(b'\\', b'\\\\'))
        copy.writestr(evil if name.startswith('inspection') else name, text)

    changed = rewritten(package, tmp_path / 'changed.zip', renamed)
    answer = command('import', changed, '--scans', other)
    assert isinstance(answer.exception, FileError)
    assert 'is not a name of a file inside of a scan' in str(answer.exception)
    assert not list(tmp_path.rglob('evil'))


def test_file_that_is_no_package_is_named(command, tmp_path):
    (tmp_path / 'x.zip').write_bytes(b'hello')
    answer = command('import', tmp_path / 'x.zip', '--scans', tmp_path / 'other')
    assert 'x.zip: is not a ZIP file of a scan' in str(answer.exception)
