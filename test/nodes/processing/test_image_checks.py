# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from types import SimpleNamespace

from ivfmc_ros.nodes.framework.health import Health
from ivfmc_ros.nodes.framework.health import Level
from ivfmc_ros.nodes.processing.image_checks import ImageChecks
from ivfmc_ros.stripe.sheet_width import SheetVerdict

ADVICE = 'laser left: its sheet looks 1.60 times as thick as when it was calibrated'


def acquisition(verdict):
    """Return the parts of an acquisition that the check uses."""
    return SimpleNamespace(clipping=lambda: None, sheets=lambda: verdict)


def test_focus_that_was_changed_is_a_condition_until_a_scan_in_focus():
    node = SimpleNamespace(health=Health(lambda *_: None))
    checks = ImageChecks(node, lambda: ['left'])
    assert checks.figures['focus'] == ''
    checks.update(acquisition(SheetVerdict(ratio={'left': 1.6}, advice=ADVICE)))
    assert checks.figures['focus'] == ADVICE
    assert node.health.worst() == (Level.WARN, f'lasers: {ADVICE}')
    # not judged, as on a translucent part
    checks.update(acquisition(None))
    assert checks.figures['focus'] == ''
    assert node.health.worst()[0] is Level.OK
    checks.update(None)
    assert checks.figures['focus'] == ''
