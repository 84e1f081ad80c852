# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticArray
from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_msgs.msg import KeyValue
import pytest

from ivfmc_ros.errors import HelperError
from ivfmc_ros.nodes.scanning.diagnostics_watch import DiagnosticsWatch
from ivfmc_ros.nodes.scanning.scan_guard import ScanGuard


@pytest.fixture
def watch():
    node = SimpleNamespace(
        get_namespace=lambda: '/ivfmc',
        guarded=lambda callback, name: callback,
        create_subscription=lambda *_, **__: None,
    )
    return DiagnosticsWatch(node)


def say(watch, fault, name='ivfmc/camera'):
    status = DiagnosticStatus(name=name, values=[KeyValue(key='fault', value=fault)])
    watch._receive(DiagnosticArray(status=[status]))


def guard(watch):
    """A guard of a scan in which everything else is well."""
    link = SimpleNamespace(
        diagnostics=watch,
        watch=SimpleNamespace(require_alive=lambda names: None),
        clocks=SimpleNamespace(require_no_jump=lambda: None),
        require_unique_profiles=lambda: None,
        unrecorded_s=0.0,
    )
    machine = SimpleNamespace(raise_if_cancelled=lambda: None)
    return ScanGuard(machine, link, 2.0, None, needs_homing=False, scan_id='one')


def test_frozen_camera_ends_a_scan_that_takes_images(watch):
    guarded = guard(watch)
    guarded()
    say(watch, 'the camera is frozen')
    with pytest.raises(HelperError, match='the camera is frozen') as caught:
        guarded()
    assert caught.value.code == 'CAMERA_LOST'
    # meshing needs no camera
    guarded.needs_images = False
    guarded()


def test_camera_that_works_again_is_no_fault(watch):
    say(watch, 'the camera delivers no images')
    say(watch, '')
    guard(watch)()


def test_camera_of_another_cell_does_not_count(watch):
    say(watch, 'the camera is frozen', 'other/camera')
    guard(watch)()
