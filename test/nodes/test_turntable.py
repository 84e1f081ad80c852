# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import os
import re
import select
import signal
import socket
import subprocess
import sys
import threading
import time

from builtin_interfaces.msg import Duration
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from std_msgs.msg import Header
from std_srvs.srv import SetBool
from support.graph_rig import node_environment
from support.graph_rig import NodeProcess
from support.graph_rig import running
from trajectory_msgs.msg import JointTrajectory
from trajectory_msgs.msg import JointTrajectoryPoint

from ivfmc_ros.nodes.convert.stamps import nanoseconds
from ivfmc_ros.simulation.live.truth import TruthReader


@pytest.fixture(scope='module')
def live(tmp_path_factory):
    """A live cell in a process of its own."""
    folder = tmp_path_factory.mktemp('live')
    words = [sys.executable, '-m', 'ivfmc_ros.simulation.live_cell', '--folder', str(folder)]
    process = subprocess.Popen(
        [*words, '--part', 'none'], env=node_environment(), stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == 'ready\n'
    yield folder
    process.terminate()
    assert process.wait(timeout=5) == 0
    assert list(folder.iterdir()) == []


class Table:
    """A client of the turntable node, and the truth of the cell behind it."""

    def __init__(self, client, folder):
        self.client = client
        self.folder = folder
        self.truth = TruthReader(folder / 'truth')
        self.joints = client.collect(JointState, 'joint_states')
        self.lasers = client.collect(JointState, 'laser_states')
        self._hold = client.publisher(Header, 'beam_hold')
        self._go = client.publisher(JointTrajectory, 'joint_trajectory')
        self.permit = client.publisher(Bool, 'beam_permit')
        client.until(lambda: self.joints and self._go.get_subscription_count(), 10.0, 'a table')

    def lit(self):
        last = self.lasers[-1]
        return [name for name, on in zip(last.name, last.position, strict=True) if on]

    def shining(self):
        """True power of each laser now."""
        now = time.monotonic()
        return self.truth.mean_laser_powers(now - 1e-3, now).tolist()

    def hold(self, laser, seconds, age=0.0):
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            message = Header(frame_id=laser)
            stamp_ns = self.client.node.get_clock().now().nanoseconds - int(age * 1e9)
            message.stamp.sec, message.stamp.nanosec = divmod(stamp_ns, 10**9)
            self._hold.publish(message)
            self.client.spin(0.1)

    def go(self, position, seconds=0.0, **changes):
        whole = int(seconds)
        point = JointTrajectoryPoint(
            positions=[position],
            velocities=[changes.get('velocity', 0.0)],
            time_from_start=Duration(sec=whole, nanosec=int((seconds - whole) * 1e9)),
        )
        names = changes.get('names', ['turntable_joint'])
        self._go.publish(
            JointTrajectory(joint_names=names, points=[point] * changes.get('points', 1))
        )

    def position(self):
        return self.joints[-1].position[0]

    def stands(self):
        return len(self.joints) > 5 and all(abs(j.velocity[0]) < 1e-6 for j in self.joints[-5:])

    def arrive(self, target, seconds=10.0):
        self.client.until(
            lambda: self.stands() and abs(self.position() - target) < 1e-3, seconds, 'arrival'
        )

    def fault(self, text):
        (self.folder / 'faults').write_text(f'{text}\n')

    def enable(self, laser, on=True):
        request = SetBool.Request(data=on)
        return self.client.call(SetBool, f'turntable/{laser}/enable', request)


@pytest.fixture(scope='module')
def node(live):
    node = NodeProcess('turntable', port=str(live / 'controller'))
    yield node
    assert node.end() == 0, node.output


@pytest.fixture
def table(client, live, node):
    table = Table(client, live)
    yield table
    assert node.alive
    if not table.stands() or any(table.shining()):
        client.trigger('turntable/stop')
    # a laser that a test left blocked stays off until none is requested
    table.hold('', 0.1)


@pytest.fixture
def others(node):
    """End the node of the module, so that another one can open the controller."""
    node.end()


def test_move_takes_the_requested_time_and_ends_at_its_target(table):
    start = time.monotonic()
    table.joints.clear()
    table.go(1.0, 1.5)
    table.arrive(1.0)
    moving = [joint for joint in table.joints if joint.velocity[0] > 1e-3]
    assert 1.4 < time.monotonic() - start < 2.5
    # 50 a second at least; the clock is the stamps'
    stamps = [joint.header.stamp.sec + joint.header.stamp.nanosec * 1e-9 for joint in moving]
    assert len(stamps) / (stamps[-1] - stamps[0]) > 45
    assert table.truth.table_state(time.monotonic())[0] == pytest.approx(1.0, abs=1e-3)


def test_joint_states_are_fewer_at_standstill(table):
    def received(seconds):
        before = len(table.joints)
        table.client.spin(seconds)
        return len(table.joints) - before

    table.client.until(lambda: received(0.5) < 12, 20.0, 'an idle rate')
    table.go(table.position() + 0.5, 1.0)
    assert received(1.0) > 30


def test_commanding_the_present_position_stops_the_table(table):
    table.go(40.0, 60.0)
    table.client.until(lambda: abs(table.joints[-1].velocity[0]) > 0.2)
    here = table.position()
    table.go(here)
    table.arrive(here, 4.0)


def test_laser_is_on_until_half_a_second_after_the_last_hold(table):
    table.hold('left', 0.8)
    assert table.lit() == ['left']
    assert table.shining() == [1.0, 0.0]
    table.hold('right', 0.3)
    assert table.lit() == ['right']
    assert table.shining() == [0.0, 1.0]
    start = time.monotonic()
    table.client.until(lambda: not table.lit())
    assert 0.2 < time.monotonic() - start < 1.0
    assert table.shining() == [0.0, 0.0]


def test_laser_goes_off_during_a_move_and_the_position_is_kept(table):
    table.hold('left', 0.4)
    table.go(table.position() + 20.0, 40.0)
    table.hold('left', 0.6)
    assert table.lit() == ['left']
    table.client.until(lambda: not table.lit(), 3.0)
    assert table.shining() == [0.0, 0.0]
    table.client.until(table.stands, 3.0)
    target = table.position() + 0.1
    table.go(target)
    table.arrive(target)


def test_unknown_laser_and_old_hold_switch_nothing_on(table):
    table.hold('middle', 0.4)
    table.hold('left', 0.4, age=5.0)
    assert table.lit() == []
    table.client.until(lambda: 'old' in table.client.diagnostic('turntable'), 3.0)


def test_enable_service_works_only_in_an_idle_cell(table):
    table.client.spin(0.6)
    answer = table.enable('right')
    assert answer.success, answer.message
    assert table.shining() == [0.0, 1.0]
    assert table.enable('right', False).success
    assert table.shining() == [0.0, 0.0]
    table.hold('', 0.2)
    answer = table.enable('right')
    assert not answer.success
    assert 'BUSY' in answer.message


def test_stop_ends_motion_and_turns_lasers_off(table):
    table.hold('left', 0.3)
    table.go(table.position() + 20.0, 40.0)
    table.hold('left', 0.3)
    success, answer = table.client.trigger('turntable/stop')
    assert success, answer
    assert table.shining() == [0.0, 0.0]
    table.client.spin(0.2)
    assert table.stands()


@pytest.mark.parametrize(
    ('changes', 'reason'),
    [
        ({'points': 2}, 'points'),
        ({'velocity': 1.0}, 'velocity'),
        ({'names': ['other']}, 'other'),
    ],
)
def test_invalid_trajectory_is_rejected(table, changes, reason):
    here = table.position()
    table.go(here + 1.0, **changes)
    table.client.until(lambda: reason in table.client.diagnostic('turntable'), 3.0)
    assert table.position() == here


def test_laser_stays_off_a_standing_table_after_the_node_hung(table, node):
    table.hold('left', 0.4)
    table.go(table.position() + 20.0, 40.0)
    table.hold('left', 0.6)
    assert table.shining() == [1.0, 0.0]
    node.process.send_signal(signal.SIGSTOP)
    table.client.until(lambda: not any(table.shining()), 1.0, 'the guard does not act')
    # no hold reaches it: those that wait in its queue are too old when it goes on
    table.client.spin(1.5)
    node.process.send_signal(signal.SIGCONT)
    for _ in range(8):
        table.hold('left', 0.1)
        assert table.shining() == [0.0, 0.0]
    table.client.until(lambda: 'POSITION_LOST' in table.client.diagnostic('turntable'), 3.0)
    success, answer = table.client.trigger('turntable/clear_alarm')
    assert success, answer


@pytest.mark.parametrize(
    ('fault', 'code'),
    [
        ('alarm 1', 'CONTROLLER_ALARM'),
        ('reset', 'POSITION_LOST'),
        ('silence 2.5', 'CONTROLLER_LOST'),
    ],
)
def test_fault_of_the_controller_is_published_in_time_under_its_code(table, fault, code):
    table.hold('right', 0.4)
    table.go(table.position() + 20.0, 40.0)
    start = time.monotonic()
    table.fault(fault)
    while f'code: {code}' not in table.client.diagnostic('turntable'):
        assert time.monotonic() - start < 2.0
        table.hold('right', 0.05)
    assert table.shining() == [0.0, 0.0]
    table.client.spin(2.6 + start - time.monotonic() if 'silence' in fault else 0.0)
    success, answer = table.client.trigger('turntable/clear_alarm')
    assert success, answer
    table.client.until(lambda: 'code:  |' in table.client.diagnostic('turntable'), 3.0)


def test_restart_of_the_controller_is_an_alarm_that_can_be_cleared(table):
    table.fault('reset')
    table.client.until(lambda: 'POSITION_LOST' in table.client.diagnostic('turntable'), 4.0)
    success, answer = table.client.trigger('turntable/clear_alarm')
    assert success, answer
    table.go(table.position() + 0.1)
    table.client.until(lambda: not table.stands())


def test_zero_has_another_identity_after_an_alarm_and_not_after_a_move(table):
    def zero():
        found = re.search(r'zero: (\S+)', table.client.diagnostic('turntable'))
        return found.group(1) if found else ''

    table.client.until(zero, 10.0, 'a zero')
    zeros = [zero()]
    target = table.position() + 0.3
    table.go(target)
    table.arrive(target)
    table.client.spin(1.2)
    assert zero() == zeros[0]
    table.fault('reset')
    # at the alarm at once, and again when it is cleared
    table.client.until(lambda: zero() != zeros[0], 5.0, 'another zero')
    zeros.append(zero())
    assert table.client.trigger('turntable/clear_alarm')[0]
    table.client.until(lambda: zero() not in zeros, 5.0, 'a third zero')
    # of one process
    assert len({one.partition('-')[0] for one in (*zeros, zero())}) == 1


def test_home_without_a_switch_returns_the_reason(table):
    success, answer = table.client.trigger('turntable/home')
    assert not success
    assert answer['code'] == 'CONTROLLER_REFUSED'


def test_lasers_stay_off_without_the_required_permit(client, live, others):
    port = str(live / 'controller')
    with running('turntable', port=port, beam_permit_required=True):
        table = Table(client, live)
        table.hold('left', 0.4)
        assert table.lit() == []
        table.permit.publish(Bool(data=True))
        table.hold('left', 0.4)
        assert table.lit() == ['left']
        table.permit.publish(Bool(data=False))
        table.hold('left', 0.3)
        assert table.lit() == []


@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGINT])
def test_lasers_are_off_after_a_signal_during_a_move(client, live, others, number):
    node = NodeProcess('turntable', port=str(live / 'controller'))
    table = Table(client, live)
    table.hold('left', 0.4)
    table.go(table.position() + 20.0, 40.0)
    table.hold('left', 0.3)
    assert table.shining() == [1.0, 0.0]
    assert node.end(number) == 0, node.output
    assert table.shining() == [0.0, 0.0]
    assert table.truth.table_state(time.monotonic())[1] == 0.0


def test_missing_controller_is_reported(client, tmp_path):
    with running('turntable', port=str(tmp_path / 'none')):
        client.until(lambda: 'none' in client.diagnostic('turntable'), 10.0)
        success, answer = client.trigger('turntable/stop')
        assert not success
        assert answer['code'] == 'CONTROLLER_LOST'


@pytest.fixture
def bridge(live):
    """URL of the controller behind a TCP socket, as from a serial device server."""
    listener = socket.create_server(('127.0.0.1', 0))
    ending = threading.Event()

    def serve():
        connection, _ = listener.accept()
        with connection, (live / 'controller').open('r+b', buffering=0) as port:
            os.set_blocking(port.fileno(), False)
            while not ending.is_set():
                for source in select.select([connection, port], [], [], 0.05)[0]:
                    if source is port:
                        connection.sendall(port.read() or b'')
                    else:
                        port.write(connection.recv(4096))

    thread = threading.Thread(target=serve)
    thread.start()
    yield f'socket://127.0.0.1:{listener.getsockname()[1]}'
    ending.set()
    thread.join()
    listener.close()


def test_controller_behind_a_url_and_parameters_set_while_it_runs(client, live, others, bridge):
    # an integer is accepted for a floating-point parameter
    with running('turntable', port=bridge, velocity=2, laser_power=1):
        table = Table(client, live)
        table.hold('left', 0.4)
        assert table.shining() == [1.0, 0.0]
        client.until(lambda: not table.lit())
        changes = {'laser_power': 0.25, 'beam_hold_timeout': 2.0, 'velocity': 0.5}
        assert client.set('turntable', **changes).successful
        table.hold('left', 0.3)
        assert table.shining() == [0.25, 0.0]
        client.spin(1.0)
        # by the old time-out it would be dark
        assert table.lit() == ['left']
        table.hold('', 0.1)
        table.go(table.position() + 0.5)
        table.joints.clear()
        client.until(lambda: table.joints and table.joints[-1].velocity[0] > 0.3)
        client.until(table.stands)
        assert max(joint.velocity[0] for joint in table.joints) < 0.51


@pytest.mark.parametrize(
    ('lasers', 'said'),
    [
        (['left laser', 'right'], "'left laser' cannot be part of a service name"),
        (['left', 'left'], 'a name occurs twice'),
        ([], 'laser_outputs: 2 for 0 lasers'),
    ],
)
def test_invalid_lasers_are_rejected_by_name(lasers, said):
    node = NodeProcess('turntable', lasers=lasers)
    node.process.wait(30)
    assert node.end() == 2
    assert said in node.output


def test_lasers_alone_without_a_table(client, live, others):
    with running('turntable', port=str(live / 'controller'), table=False):
        lasers = client.collect(JointState, 'laser_states')
        client.until(lambda: lasers, 10.0)
        assert client.node.count_publishers('joint_states') == 0


def test_stamps_of_the_lasers_increase_while_the_controller_is_connected(client, live, others):
    lasers = client.collect(JointState, 'laser_states')
    with running('turntable', port=str(live / 'controller')):
        client.until(lambda: len(lasers) > 20, 20.0)
    stamps = [nanoseconds(message.header.stamp) for message in lasers]
    assert stamps[0] > 0
    assert stamps == sorted(stamps)
