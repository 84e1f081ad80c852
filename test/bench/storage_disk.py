# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A disk that fills up: a recorder that is not told, and a cell that watches it; on a tmpfs."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextlib import suppress
import math
import os
from pathlib import Path
import shutil
import subprocess
import time

from support.fault_cell import FaultCell
from support.fault_cell import FaultClient
from support.fault_cell import SCAN_S
from support.fault_effects import await_result
from support.fault_effects import start
from support.killed_recorder import encoded_profiles
from support.killed_recorder import TOPIC
from support.recordings import messages_of
from support.recordings import profile
from support.recordings import START

from bench import at_least
from bench import at_most
from bench import Number
from ivfmc_ros.errors import FileError
from ivfmc_ros.storage.messages.profile_header import read_profile_header
from ivfmc_ros.storage.messages.sensor_messages import POINT_CLOUD
from ivfmc_ros.storage.recording.live_recorder import LiveRecorder
from ivfmc_ros.storage.repair import check_recording
from ivfmc_ros.storage.repair import repair_recording

# Sizes of the disks, MB: a recorder fills its own within a second.
_RECORDER_MB, _CELL_MB = 10, 600
# What the orchestrator keeps free, MB; less than the disk of the cell.
_RESERVE_MB = 200.0
_POINTS = 500  # of a profile that is recorded: 24 kB
_FREED = 3_000_000  # bytes that are freed after the disk was full
_SOME = 5  # profiles of a scan that are on disk before it is filled
# A scan that takes its time, so that a busy machine does not end it.
_REQUEST = {'motion': 'step', 'profiles': 40, 'lasers': ['left'], 'home': False}


def full_disks(folder: Path) -> Iterator[Number]:
    """Yield the figures of both; those of a machine without root's mount are NaN."""
    try:
        with small_disk(folder / 'recorder', _RECORDER_MB) as disk:
            yield from recorder_figures(disk)
        with small_disk(folder / 'cell', _CELL_MB) as disk:
            yield from cell_figures(disk)
    except PermissionError as error:
        yield Number('disk_full', math.nan, '', at_most(0), f'not measured: {error}')


@contextmanager
def small_disk(folder: Path, megabytes: int) -> Iterator[Path]:
    """
    Mount a tmpfs of a size.

    :raises PermissionError: this user may not mount
    """
    folder.mkdir(parents=True)
    command = ['mount', '-t', 'tmpfs', '-o', f'size={megabytes}m', 'tmpfs', str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise PermissionError(done.stderr.strip())
    try:
        yield folder
    finally:
        # --lazy: a process that was killed may still have a file open
        subprocess.run(['umount', '--lazy', str(folder)], check=True)


def recorder_figures(disk: Path) -> Iterator[Number]:
    """Record until the disk is full; then free some of it, repair, and record again."""
    filler = disk / 'filler'
    filler.write_bytes(bytes(_FREED))
    messages = encoded_profiles(_POINTS)
    recorder, added = _record(disk / 's1', messages, len(messages))
    error = recorder.error or ''
    acknowledged = -1 if recorder.recorded is None else recorder.recorded
    left = {time_ns - START: data for _, time_ns, data in messages_of(disk / 's1')}
    missing = set(range(acknowledged + 1)) - left.keys()
    wrong = sum(messages[seq] != data for seq, data in left.items())
    # without the folder of this run
    said = error.replace(f'{disk}/', '')
    note = f'of {acknowledged + 1} acknowledged, {added} recorded; "{said}"'
    yield Number('disk_full_lost', len(missing), 'profiles', at_most(0), note)
    yield Number('disk_full_wrong', wrong, 'profiles', at_most(0))
    is_said = 'No space left' in error
    yield Number('disk_full_said', is_said, 'of 1', at_least(1))
    filler.unlink()
    # a repair copies what there is: the scan goes to another disk first
    shutil.move(disk / 's1', disk.parent / 's1')
    repair_recording(disk.parent / 's1')
    repaired = messages_of(disk.parent / 's1')
    yield Number('disk_full_repaired', len(repaired) - len(left), 'profiles', at_least(0))
    _record(disk / 's2', messages, 20)
    is_sound = check_recording(disk / 's2').is_complete and len(messages_of(disk / 's2')) == 20
    yield Number('disk_full_next', is_sound, 'of 1', at_least(1), 'next recording is whole')


def _record(folder: Path, messages: list[bytes], count: int) -> tuple[LiveRecorder, int]:
    """Record profiles until there are so many, or it fails; return the number of them."""
    folder.mkdir()
    recorder = LiveRecorder(folder, compress=False)
    header = read_profile_header(profile(0))
    added = 0
    for seq in range(count):
        if recorder.error is not None:
            break
        own = type(header)(**{**vars(header), 'seq': seq})
        recorder.add(TOPIC, POINT_CLOUD, messages[seq], START + seq, header=own)
        added += 1
        time.sleep(0.004)
    with suppress(FileError):
        recorder.stop()
    return recorder, added


def _await_profiles(client: FaultClient, scan_id: str, begin_s: float) -> None:
    """Wait until a scan has some profiles on disk, or has ended."""

    def taken() -> bool:
        written = max((count for when, count in client.counts if when > begin_s), default=-1)
        return client.state(scan_id).get('stage') == 'SCANNING' and written >= _SOME

    client.wait(lambda: taken() or client.result(scan_id), SCAN_S)


def cell_figures(disk: Path) -> Iterator[Number]:
    """Fill the disk of a cell in the middle of a scan; free it, and scan again."""
    client = FaultClient()
    try:
        cell = FaultCell(client, disk)
        cell.ensure()
        result = client.set('orchestrator', min_free_space=_RESERVE_MB)
        if not result.successful:
            raise RuntimeError(result.reason)
        begin_s = time.monotonic()
        scan_id = start(cell, _REQUEST)
        _await_profiles(client, scan_id, begin_s)
        filler = disk / 'filler'
        free = shutil.disk_usage(disk).free
        with filler.open('wb') as stream:
            size = int(free - 0.9 * _RESERVE_MB * 1e6)
            os.posix_fallocate(stream.fileno(), 0, size)
        filled_s = time.monotonic()
        code = await_result(cell, scan_id)
        seconds = time.monotonic() - filled_s
        counts = [count for when, count in client.counts if when > begin_s]
        acknowledged = max(counts, default=-1)
        lost = cell.lost_profiles(scan_id, acknowledged)
        check = check_recording(cell.scans / scan_id)
        filler.unlink(missing_ok=True)
        following = await_result(cell, start(cell, _REQUEST))
        cell.end()
    finally:
        client.close()
    is_said = code == 'DISK_FULL'
    yield Number('full_cell_said', is_said, 'of 1', at_least(1), f'{code} in {seconds:.1f} s')
    note = f'of {acknowledged + 1} acknowledged'
    yield Number('full_cell_lost', lost, 'profiles', at_most(0), note)
    yield Number('full_cell_sound', check.is_sound, 'of 1', at_least(1), '; '.join(check.lines()))
    yield Number('full_cell_next', following == 'OK', 'of 1', at_least(1), following)
    yield Number('full_cell_orphans', cell.orphans, '', at_most(0))
