# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from hypothesis import given
import pytest
from support.line_fuzz import check_all
from support.line_fuzz import CHECKS
from support.line_fuzz import fuzz_settings
from support.line_fuzz import lines


@pytest.mark.parametrize('name', CHECKS)
def test_no_line_raises_hangs_or_passes_for_an_ok(name):
    @fuzz_settings(3000)
    @given(lines())
    def run(texts):
        check_all(CHECKS[name], texts)

    run()


def test_check_finds_a_parser_that_takes_damage_for_ok(monkeypatch):
    from ivfmc_ros.devices.grbl import protocol

    monkeypatch.setattr(protocol, 'parse', lambda text: protocol.Response())
    with pytest.raises(AssertionError):
        CHECKS['GRBL family']('okk')
