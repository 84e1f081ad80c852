# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

from ivfmc_ros.cli.calibrate import options


def test_only_known_conditions_are_noted():
    assert options.condition_notes(None, None) == {}
    assert options.condition_notes(21.0, None) == {'temperature_c': 21.0}
    assert options.condition_notes(None, 0.005) == {'exposure': 0.005}


def test_file_names_that_look_like_markup_are_printed_literally(capsys):
    folder = Path('Prüfling [neu]')
    options.print_result(
        'Laser', [('rms', '[0.1]')], ['see [/x]'], [folder / 'cell.yaml'], {'[b].png': 'dark'}
    )
    printed = capsys.readouterr().out
    for text in ('[0.1]', 'warning: see [/x]', 'Prüfling [neu]/cell.yaml', '[b].png'):
        assert text in printed
