# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Storage: damaged and foreign bags, killed recorders, full disks, large catalogues, writers, a
cluster, offline speed.
"""

from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
import os
from pathlib import Path
import random
import signal
import tempfile
import threading
import time

import numpy as np
import sqlalchemy as sql
from support import postgres
from support.batch_work import slow_work
from support.batch_work import Task
from support.killed_recorder import encoded_profiles
from support.killed_recorder import kill_recorder
from support.recordings import messages_of
from support.recordings import write_profiles

from bench import at_least
from bench import at_most
from bench import Number
from bench.storage_disk import full_disks
from bench.storage_foreign import foreign_bags
from ivfmc_ros.errors import ScanError
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.catalogue.schema import SCANS
from ivfmc_ros.storage.catalogue.schema import VIEWS
from ivfmc_ros.storage.catalogue.search import ScanFilter
from ivfmc_ros.storage.messages.profile_header import ProfileHeader
from ivfmc_ros.storage.recording.profile_location import ProfileLocation
from ivfmc_ros.storage.repair import check_recording
from ivfmc_ros.storage.repair import repair_recording

FLIPS = 1000
PROFILES, PER_CHUNK = 40, 4
# Kills of the recorder, seconds after its first profile, and points of a profile.
KILLS, KILL_S, KILLED_POINTS = 50, (0.0, 2.0), 500
SEED = 20261127
SCANS_LISTED = 100_000
WRITERS, UPDATES = 64, 20
# Pictures of a scan, and of a shorter one, whose processes must not need less memory.
PICTURES, FEW_PICTURES, SHAPE = 720, 180, (1024, 1280)
JOBS = 16


def run() -> Iterator[Number]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        yield from flips(folder / 'flips')
        yield from cuts(folder / 'cuts')
        yield from foreign_bags(folder / 'foreign')
        yield from kills(folder / 'kills')
        yield from full_disks(folder / 'disks')
        yield from large_catalogue(folder / 'sqlite', '', 'sqlite')
        if postgres.programs() is None:
            print('storage: no PostgreSQL on this machine: its figures are left out')
        else:
            with postgres.running_server() as server:
                yield from large_catalogue(folder / 'plant', server.url, 'postgresql')
                yield from writers(folder / 'plant', server.url)
        yield from cluster(folder)
        yield from speed(folder / 'speed')


class Damage:
    """What happened when damaged copies of one bag were read and repaired."""

    def __init__(self, folder: Path) -> None:
        write_profiles(folder / 's1', range(PROFILES), per_chunk=PER_CHUNK)
        self._scan = folder / 's1'
        self._file = self._scan / 'scan.mcap'
        self._metadata = (self._scan / 'metadata.yaml').read_bytes()
        self.content = self._file.read_bytes()
        self._whole = messages_of(self._scan)
        self.counts: Counter[str] = Counter()
        self.slowest = 0.0
        self.least_left = PROFILES

    def add(self, content: bytes) -> None:
        for path in self._scan.iterdir():
            path.unlink()
        self._file.write_bytes(content)
        (self._scan / 'metadata.yaml').write_bytes(self._metadata)
        begin = time.perf_counter()
        try:
            self._read_and_repair()
        except ScanError:
            self.counts['refused'] += 1
        except Exception as error:
            print(f'storage: crash: {type(error).__name__}: {error}')
            self.counts['crashes'] += 1
        self.slowest = max(self.slowest, time.perf_counter() - begin)

    def _read_and_repair(self) -> None:
        try:
            plain = messages_of(self._scan)
            self.counts['wrong'] += plain != self._whole
        except ScanError:
            self.counts['found'] += 1
        salvaged = messages_of(self._scan, salvage=True)
        self.counts['wrong'] += not set(salvaged) <= set(self._whole)
        said = sum(check_recording(self._scan).lost.values())
        repair_recording(self._scan)
        left = messages_of(self._scan)
        self.counts['wrong'] += not set(left) <= set(self._whole)
        self.counts['repaired'] += 1
        self.counts['unsaid'] += len(left) + said < PROFILES
        self.least_left = min(self.least_left, len(left))


def flips(folder: Path) -> Iterator[Number]:
    damage = Damage(folder)
    rng = random.Random(SEED)
    for _ in range(FLIPS):
        data = bytearray(damage.content)
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        damage.add(bytes(data))
    note = f'{FLIPS} flips of one bit; {damage.counts["found"]} found when read, '
    note += f'{damage.counts["refused"]} refused (first bytes of the file)'
    yield Number('flips_wrong', damage.counts['wrong'], 'bags', at_most(0), note)
    yield Number('flips_crashes', damage.counts['crashes'], 'bags', at_most(0))
    yield Number('flips_unsaid', damage.counts['unsaid'], 'bags', at_most(0), 'a loss not named')
    yield Number(
        'flips_left',
        damage.least_left,
        'profiles',
        at_least(PROFILES - PER_CHUNK),
        f'of {PROFILES} after a repair, in the worst case; {PER_CHUNK} in a chunk',
    )
    yield Number('flips_slowest', damage.slowest, 's', at_most(10.0), 'read, checked and repaired')


def cuts(folder: Path) -> Iterator[Number]:
    damage = Damage(folder)
    # every record begins and ends somewhere: a prime step meets all classes of offsets
    for keep in range(9, len(damage.content), 13):
        damage.add(damage.content[:keep])
    note = f'cut at {sum(damage.counts[key] for key in ("repaired", "refused", "crashes"))} places'
    yield Number('cuts_wrong', damage.counts['wrong'], 'bags', at_most(0), note)
    yield Number('cuts_crashes', damage.counts['crashes'], 'bags', at_most(0))
    yield Number('cuts_slowest', damage.slowest, 's', at_most(10.0), 'read, checked and repaired')


def kills(folder: Path) -> Iterator[Number]:
    """Kill a recorder at random moments, and look for what it had acknowledged."""
    messages = encoded_profiles(KILLED_POINTS)
    rng = random.Random(SEED)
    found = [
        kill_recorder(folder / str(number) / 's1', messages, rng.uniform(*KILL_S))
        for number in range(KILLS)
    ]
    for kill in found:
        if kill.fault:
            print(f'storage: killed recorder: {kill.fault}')
    acknowledged = sum(kill.acknowledged for kill in found)
    note = f'of {acknowledged} acknowledged profiles, {KILLS} kills of the recorder in mid-scan'
    yield Number('kills_lost', sum(kill.lost for kill in found), 'profiles', at_most(0), note)
    yield Number('kills_wrong', sum(kill.wrong for kill in found), 'profiles', at_most(0))
    unrepaired = sum(bool(kill.fault) for kill in found)
    yield Number('kills_unrepaired', unrepaired, 'bags', at_most(0))


def large_catalogue(root: Path, url: str, name: str) -> Iterator[Number]:
    catalogue = Catalogue(root, create=True, url=url, cell='bench')
    fill(catalogue)
    filters = {
        'part_and_week': ScanFilter(part='part7', since='2026-03-01', until='2026-03-08'),
        'verdict_newest': ScanFilter(verdict='fail', newest=200),
    }
    for key, wanted in filters.items():
        seconds = []
        for _ in range(9):
            begin = time.perf_counter()
            found = catalogue.find(wanted)
            seconds.append(time.perf_counter() - begin)
        note = f'{len(found)} of {SCANS_LISTED} scans, median of 9'
        yield Number(f'list_{name}_{key}', float(np.median(seconds)), 's', at_most(0.2), note)
    catalogue.close()


def fill(catalogue: Catalogue) -> None:
    """Add the scans of a year, two views each, of 20 parts."""
    with catalogue.database.write() as connection:
        first = {'stage': 'DONE', 'code': 'OK', 'folder': 'x', 'parameters': '{}'}
        keys = []
        for part in range(20):
            values = {**first, 'scan_id': f'first{part}', 'created': '2025-12-31T00:00:00.000Z'}
            key = catalogue.insert_scan(connection, values, part=f'part{part}', recipe='')
            keys.append(connection.execute(
                sql.select(SCANS.c.cell, SCANS.c.part, SCANS.c.recipe).where(SCANS.c.id == key)
            ).mappings().one())  # fmt: skip
        top = 1000
        rows = []
        for number in range(SCANS_LISTED):
            day = number * 365 // SCANS_LISTED
            created = np.datetime64('2026-01-01T00:00:00.000') + np.timedelta64(day, 'D')
            rows.append({
                **first, **keys[number % 20], 'id': top + number, 'scan_id': f's{number}',
                'created': f'{created + np.timedelta64(number % 86400, "s")}Z',
                'verdict': 'fail' if number % 50 == 0 else 'pass', 'deleted': '',
            })  # fmt: skip
        connection.execute(sql.insert(SCANS), rows)
        views = [
            {'scan': top + number, 'view': view, 'laser': view, 'profiles': 360, 'points': 10**5,
             'first_angle': 0.0, 'last_angle': 6.28}
            for number in range(SCANS_LISTED) for view in range(2)
        ]  # fmt: skip
        connection.execute(sql.insert(VIEWS), views)


def writers(root: Path, url: str) -> Iterator[Number]:
    def write(number: int) -> None:
        cell = Catalogue(root, url=url, cell=f'writer{number}')
        cell.add_scan('w1', 'bracket', '', 'SCANNING', {})
        for seq in range(UPDATES):
            header = ProfileHeader(
                seq=seq, view=0, laser=0, angle=0.1 * seq, points=5, stamp_ns=seq
            )
            cell.add_profiles('w1', [ProfileLocation(
                header=header, topic='/p', index=seq, log_time_ns=seq, chunk_offset=8
            )])  # fmt: skip
        cell.set_stage('w1', 'DONE', 'WRITTEN')
        cell.close()

    begin = time.perf_counter()
    with ThreadPoolExecutor(WRITERS) as pool:
        list(pool.map(write, range(WRITERS)))
    seconds = time.perf_counter() - begin
    catalogue = Catalogue(root, url=url, cell='bench')
    found = catalogue.find(ScanFilter(code='WRITTEN'))
    lost = WRITERS * UPDATES - sum(scan.profiles for scan in found)
    note = f'{WRITERS} writers at once, {UPDATES} transactions each, in {seconds:.1f} s'
    yield Number('writers_lost', lost, 'rows', at_most(0), note)
    catalogue.close()


def cluster(folder: Path) -> Iterator[Number]:
    """Run jobs on two workers of a local cluster, one of which is killed in the middle."""
    try:
        import distributed
    except ModuleNotFoundError:
        print('storage: Dask is not installed: its figures are left out')
        return
    from ivfmc_ros.cli.batch.executors import run_on_cluster

    log = folder / 'jobs'
    tasks = [Task(str(number), log) for number in range(JOBS)]
    options = {'n_workers': 2, 'threads_per_worker': 1, 'dashboard_address': ':0'}
    with distributed.LocalCluster(**options) as made:
        victim = next(iter(made.workers.values())).pid
        timer = threading.Timer(1.5, os.kill, (victim, signal.SIGKILL))
        timer.start()
        results = list(run_on_cluster(tasks, made.scheduler_address, slow_work))
        timer.join()
    counts = Counter(map(str, results))
    missing = sum(str(number) not in counts for number in range(JOBS))
    twice = sum(count > 1 for count in counts.values())
    note = f'{JOBS} jobs, 2 workers, one killed in mid-job'
    yield Number('cluster_missing', missing, 'results', at_most(0), note)
    yield Number('cluster_twice', twice, 'results', at_most(0), note)


def speed(folder: Path) -> Iterator[Number]:
    """Measure profiles of a bag of raw pictures, with one process and with two of them at once."""
    from bench.storage_speed import measure
    from bench.storage_speed import write_scan

    write_scan(folder / 'few', FEW_PICTURES, SHAPE)
    _, little = measure(folder / 'few', 1)
    write_scan(folder / 'whole', PICTURES, SHAPE)
    peak = 0.0
    for jobs, bar in ((1, None), (2, at_least(150.0))):
        seconds, peak = measure(folder / 'whole', jobs)
        note = f'{PICTURES} pictures of {SHAPE[1]} x {SHAPE[0]} in each of {jobs} bags'
        yield Number(f'pictures_{jobs}_jobs', jobs * PICTURES / seconds, '1/s', bar, note)
    yield Number('peak_memory', peak, 'MiB', at_most(1024.0), 'of the largest process')
    raw = (PICTURES - FEW_PICTURES) * SHAPE[0] * SHAPE[1] / 2**20
    note = f'from {FEW_PICTURES} to {PICTURES} pictures, {raw:.0f} MiB more in the bag'
    yield Number('memory_growth', peak - little, 'MiB', at_most(0.1 * raw), note)
