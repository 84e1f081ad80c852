# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A cell without ROS behind a gateway."""

from contextlib import contextmanager
import json
import threading
import time

from ivfmc_ros.cli.gateway.cell_gateway import CellGateway
from ivfmc_ros.errors import HelperError

IDLE = {
    'scan_id': '', 'stage': 'IDLE', 'views_done': '', 'views_total': '', 'profiles_done': '',
    'profiles_total': '', 'eta_s': '', 'code': '', 'verdict': '', 'result': '', 'report': '',
    'report_error': '',
}  # fmt: skip


class CellWithoutRos:
    """
    Stands in for CellClient: scans end when ``finish`` is called.

    calls : what was asked, with the parameters of a scan that starts
    delay_s : of each answer
    """

    namespace = '/ivfmc'

    def __init__(self):
        self.status = dict(IDLE)
        self.silent_s = 0.0
        self.calls = []
        self.delay_s = 0.0
        self._values = {}
        self._count = 0

    def spin(self, seconds):
        time.sleep(0.005)

    @contextmanager
    def parameters(self, node, values):
        if 'profiles' in values and not isinstance(values['profiles'], int):
            raise HelperError('BAD_PARAMETER', f'{node}: profiles: must be a whole number')
        self._values = values
        yield
        self._values = {}

    def trigger(self, name):
        time.sleep(self.delay_s)
        self.calls.append((name, self._values))
        if name == 'start_scan':
            if self.status['stage'] == 'SCANNING':
                scan_id = self.status['scan_id']
                raise HelperError('BUSY', f'BUSY: scan {scan_id} is SCANNING', scan_id=scan_id)
            self._count += 1
            scan_id = f'scan_{self._count}'
            self.status = {
                **IDLE, 'scan_id': scan_id, 'stage': 'SCANNING', 'views_done': '0',
                'views_total': '2', 'profiles_done': '7', 'profiles_total': '400', 'eta_s': '12.5',
            }  # fmt: skip
            return {'code': 'OK', 'scan_id': scan_id, 'folder': '/scans'}
        if self.status['stage'] != 'SCANNING':
            raise HelperError('WRONG_STATE', 'WRONG_STATE: no scan is running')
        return {'code': 'OK', 'stage': 'SCANNING'}

    def finish(self, code='OK', verdict='pass'):
        scan_id = self.status['scan_id']
        result = json.dumps({'code': code, 'scan_id': scan_id, 'verdict': verdict})
        self.status = {
            **self.status, 'stage': 'DONE', 'code': code, 'verdict': verdict, 'result': result,
        }  # fmt: skip


@contextmanager
def gateway_of(cell):
    """Yield a gateway of the cell, with the thread that talks to it."""
    gateway, ending = CellGateway(cell), threading.Event()
    thread = threading.Thread(target=gateway.run, args=(ending,))
    thread.start()
    try:
        yield gateway
    finally:
        ending.set()
        thread.join(10.0)
        assert not thread.is_alive()
