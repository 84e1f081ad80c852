# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A recorder in a process that is killed: what it had acknowledged must be in the repaired bag."""

from dataclasses import dataclass
import multiprocessing
import os
from pathlib import Path
import signal
import struct
import time

from ivfmc_ros.errors import FileError
from ivfmc_ros.storage.bag.reader import open_bag
from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.storage.messages.profile_header import read_profile_header
from ivfmc_ros.storage.messages.sensor_messages import POINT_CLOUD
from ivfmc_ros.storage.recording.live_recorder import LiveRecorder
from ivfmc_ros.storage.repair import check_recording
from ivfmc_ros.storage.repair import repair_recording
from support.recordings import profile
from support.recordings import START

TOPIC = '/ivfmc/profile'
# Messages that are recorded over and over; encoding each anew would take most of the time.
_DIFFERENT = 400
# Seconds between two profiles, as of a camera of 250 images a second.
_PERIOD_S = 0.004
_COUNT = struct.Struct('<q')


@dataclass(frozen=True, kw_only=True)
class Kill:
    """
    What was left after a kill.

    acknowledged, kept : number of profiles: that ``recorded`` had counted, of the repaired bag
    lost : acknowledged profiles that the repaired bag does not have
    wrong : profiles of the repaired bag that are not as they were recorded
    fault : why the bag could not be repaired or is not sound, '' otherwise
    """

    acknowledged: int
    kept: int
    lost: int
    wrong: int
    fault: str


def encoded_profiles(points: int) -> list[bytes]:
    """Return the messages that ``kill_recorder`` records, with so many points each."""
    return [cdr.encode(profile(seq, points=points)) for seq in range(_DIFFERENT)]


def kill_recorder(folder: Path, messages: list[bytes], seconds: float) -> Kill:
    """Kill a recorder by SIGKILL so long after its first profile, and repair what it left."""
    folder.mkdir(parents=True)
    reading, writing = os.pipe()
    # a copy of this process: an import would take longer than the recording
    process = multiprocessing.get_context('fork').Process(
        target=_record, args=(folder, messages, writing), daemon=True
    )
    process.start()
    os.close(writing)
    with os.fdopen(reading, 'rb') as acknowledgements:
        # the first count is that of the begin
        acknowledgements.read(_COUNT.size)
        time.sleep(seconds)
        os.kill(process.pid or 0, signal.SIGKILL)
        process.join()
        data = acknowledgements.read()
    counts = [count for (count,) in _COUNT.iter_unpack(data[: len(data) // 8 * 8])]
    return _judge(folder, messages, max(counts, default=0))


def _record(folder: Path, messages: list[bytes], pipe: int) -> None:
    """Record profiles until the process is killed; writes the number of acknowledged ones."""
    recorder = LiveRecorder(folder)
    header = read_profile_header(profile(0))
    os.write(pipe, _COUNT.pack(0))
    acknowledged = 0
    for seq, data in enumerate(messages):
        recorder.add(
            TOPIC,
            POINT_CLOUD,
            data,
            START + seq,
            header=type(header)(**{**vars(header), 'seq': seq}),
        )
        time.sleep(_PERIOD_S)
        if recorder.recorded is not None and recorder.recorded + 1 != acknowledged:
            acknowledged = recorder.recorded + 1
            os.write(pipe, _COUNT.pack(acknowledged))
    # recorded all before the kill: the end of the bag is written as well
    recorder.stop()
    time.sleep(60.0)


def _judge(folder: Path, messages: list[bytes], acknowledged: int) -> Kill:
    found: dict[int, bytes] = {}
    fault = ''
    try:
        repair_recording(folder)
        check = check_recording(folder)
        fault = '' if check.is_sound else '; '.join(check.lines())
        bag = open_bag(folder)
        found = {raw.log_time_ns - START: raw.data for raw in bag.messages(list(bag.topics))}
    except FileError as error:
        fault = str(error)
    return Kill(
        acknowledged=acknowledged,
        kept=len(found),
        lost=len(set(range(acknowledged)) - found.keys()),
        wrong=sum(messages[seq] != data for seq, data in found.items()),
        fault=fault,
    )
