# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

from ivfmc_ros.cli.calibrate import options


def test_names_that_look_like_markup_are_said_as_they_are(capsys):
    folder = Path('Prüfling [neu]')
    options.say(
        'Laser', [('rms', '[0.1]')], ['see [/x]'], [folder / 'cell.yaml'], {'[b].png': 'dark'}
    )
    said = capsys.readouterr().out
    for text in ('[0.1]', 'warning: see [/x]', 'Prüfling [neu]/cell.yaml', '[b].png'):
        assert text in said
