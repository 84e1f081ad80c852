# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What a plant of scanners needs: bytes, database and processors of a scan, and of those of a day.

The scan is the demo part in the bench cell, in full, with two lasers.
"""

from collections.abc import Iterable
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
import resource
import tempfile
import time
from typing import Any

import numpy as np
from rclpy.serialization import serialize_message
import sqlalchemy as sql
from support import postgres

from bench import Number
from ivfmc_ros.cell.cell_file import save_cell
from ivfmc_ros.cli.support.source import BagOptions
from ivfmc_ros.cli.support.source import read_scan
from ivfmc_ros.nodes.convert import clouds
from ivfmc_ros.nodes.convert.meshes import marker
from ivfmc_ros.nodes.convert.meshes import mesh_shape
from ivfmc_ros.pipeline import measure_profiles
from ivfmc_ros.pipeline import reconstruct
from ivfmc_ros.pipeline import reconstruct_profiles
from ivfmc_ros.pipeline import Settings
from ivfmc_ros.results import write_results
from ivfmc_ros.simulation.bench import bench_cell
from ivfmc_ros.simulation.parts.solids import demo_part
from ivfmc_ros.simulation.render.renderer import simulate_scan
from ivfmc_ros.storage.bag.writer import create_bag
from ivfmc_ros.storage.bag.writer import FILE_NAME
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.catalogue.schema import FEATURES
from ivfmc_ros.storage.catalogue.schema import VERDICTS
from ivfmc_ros.storage.messages.profile_header import ProfileHeader
from ivfmc_ros.storage.messages.sensor_messages import POINT_CLOUD
from ivfmc_ros.storage.recording.live_recorder import ProfileLocation

# Table angles of the scan, for each of two lasers.
STEPS = 360
# The plant: cells, scans of each a day, pictures a second while one is taken.
CELLS, SCANS_A_DAY, PICTURE_RATE = 100, 200, 60.0
# Updates of the catalogue that a cell makes each second while it scans (LiveRecorder: one for
# each chunk, every 0.25 s).
UPDATE_RATE = 4.0
# Scans whose size in the database is measured, features that an inspection stores of each, and
# updates of each of the cells that write at once.
STORED, FEATURES_A_SCAN, UPDATES = 100, 20, 10
# Time in which the scans of one day are to be processed again.
NIGHT_H = 8.0
# Triangles of the mesh in the bag (parameter display_triangles of mesher).
DISPLAYED = 50_000
DAY_S, HOUR_S = 86_400.0, 3_600.0
START = 1_700_000_000_000_000_000
# Files of a reconstruction that the scan of a cell does not have.
_OFFLINE = ('mesh.obj', 'cloud.ply', 'cloud.png')
_KB, _MB, _GB, _TB = 1e3, 1e6, 1e9, 1e12

Message = tuple[str, str, bytes, int]


@dataclass(frozen=True, kw_only=True)
class ScanFigures:
    """
    What one scan takes.

    count : number of its profiles
    pictures, profiles, views : bytes in the bag: images, profiles, views with cloud and mesh
    files : bytes of the mesh and report files that a scan of a cell has by default
    seconds, profile_seconds : of one core, from the pictures and from the stored profiles
    """

    count: int
    pictures: float
    profiles: float
    views: float
    files: float
    seconds: float
    profile_seconds: float

    @property
    def without_pictures(self) -> float:
        """Bytes of the scan without its pictures."""
        return self.profiles + self.views + self.files

    @property
    def whole(self) -> float:
        """Bytes of the scan."""
        return self.pictures + self.without_pictures


def run() -> Iterator[Number]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scan = measure_scan(folder)
        yield from of_a_scan(scan)
        yield from of_a_day(scan)
        yield from of_the_database(folder / 'database', scan.count)


def measure_scan(folder: Path) -> ScanFigures:
    """Write the bag of a scan as the recorder does, reconstruct it, and write the results."""
    cell = bench_cell()
    with create_bag(folder / 'pictures') as bag:
        for frame in simulate_scan(cell, demo_part(), STEPS):
            states = {laser.name: k == frame.laser for k, laser in enumerate(cell.lasers)}
            bag.joint_state(frame.stamp_ns, cell.turntable.joint, frame.angle)
            bag.laser_state(frame.stamp_ns - 10_000_000, states)
            bag.camera_info(frame.stamp_ns, cell.camera)
            bag.image(frame.stamp_ns, frame.image)
    pictures = _size(folder / 'pictures')
    save_cell(folder / 'pictures' / 'cell.yaml', cell)
    begin = _processor_s()
    scan, cell = read_scan(folder / 'pictures', None, None, BagOptions())
    made = reconstruct(cell, scan.frames(), Settings())
    write_results(folder / 'result', cell, made, 'scan', {})
    seconds = _processor_s() - begin
    names = [path for path in (folder / 'result').iterdir() if path.name not in _OFFLINE]
    files = sum(path.stat().st_size for path in names)
    profiles = measure_profiles(cell, scan.frames(), made.settings)
    begin = _processor_s()
    again = reconstruct_profiles(cell, profiles, Settings())
    write_results(folder / 'again', cell, again, 'scan', {})
    profile_seconds = _processor_s() - begin
    # of the mesh that is displayed; any of its triangles, because their number gives the bytes
    used, numbers = np.unique(made.mesh.faces[:DISPLAYED], return_inverse=True)
    vertices, faces = made.mesh.vertices_xyz[used], numbers.reshape(-1, 3)
    sent = [clouds.from_view(view, START) for view in made.views]
    sent.append(clouds.from_views(made.views, made.poses, START))
    return ScanFigures(
        count=len(profiles),
        pictures=pictures,
        profiles=write_bag(folder / 'profiles', _encoded(map(clouds.from_profile, profiles))),
        views=write_bag(folder / 'views', [
            *_encoded(sent),
            ('mesh', 'visualization_msgs/msg/Marker', marker(vertices, faces, START), START),
            ('mesh_shape', 'shape_msgs/msg/Mesh', mesh_shape(vertices, faces), START),
        ]),
        files=files,
        seconds=seconds,
        profile_seconds=profile_seconds,
    )  # fmt: skip


def _processor_s() -> float:
    """Return the time of the processor of this process and its ended children, seconds."""
    found = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in found)


def _encoded(sent: Iterable[Any]) -> Iterator[Message]:
    for number, message in enumerate(sent):
        yield 'cloud', POINT_CLOUD, serialize_message(message), START + number


def write_bag(folder: Path, messages: Iterable[Message]) -> int:
    """Write messages to a bag, and return its size in bytes."""
    with create_bag(folder) as bag:
        for topic, kind, data, stamp_ns in messages:
            bag.write(topic, kind, data, stamp_ns)
    return _size(folder)


def _size(folder: Path) -> int:
    return (folder / FILE_NAME).stat().st_size


def of_a_scan(scan: ScanFigures) -> Iterator[Number]:
    count = scan.count
    note = f'{count} profiles of the demo part, pictures of 1280 x 1024, chunks of zstd'
    yield Number('picture', scan.pictures / count / _KB, 'kB', None, note)
    yield Number('profile', scan.profiles / count / _KB, 'kB')
    yield Number('views, cloud, mesh in the bag', scan.views / _MB, 'MB')
    yield Number('mesh and report files', scan.files / _MB, 'MB', None, 'STL, PLY, HTML, JSON')
    yield Number('scan', scan.whole / _MB, 'MB')
    yield Number('scan without pictures', scan.without_pictures / _MB, 'MB')
    note = 'of one core, with mesh and report'
    yield Number('reconstruct from pictures', scan.seconds, 's', None, note)
    yield Number('reconstruct from profiles', scan.profile_seconds, 's', None, note)


def of_a_day(scan: ScanFigures) -> Iterator[Number]:
    scans = CELLS * SCANS_A_DAY
    note = f'{CELLS} cells, {SCANS_A_DAY} scans of each'
    yield Number('a day', scans * scan.whole / _TB, 'TB', None, note)
    yield Number('a day without pictures', scans * scan.without_pictures / _GB, 'GB')
    rate = PICTURE_RATE * scan.pictures / scan.count
    yield Number('disk of a cell that scans', rate / _MB, 'MB/s', None, f'{PICTURE_RATE:g} Hz')
    mean = scans / DAY_S * 8.0
    yield Number('network, mean', mean * scan.whole / _GB, 'Gbit/s', None, 'bags to an archive')
    yield Number('network without pictures', mean * scan.without_pictures / _GB, 'Gbit/s')
    note = f'the scans of a day again in {NIGHT_H:g} h'
    night = NIGHT_H * HOUR_S
    yield Number('cores, from pictures', scans * scan.seconds / night, '', None, note)
    yield Number('cores, from profiles', scans * scan.profile_seconds / night, '', None, note)


def of_the_database(folder: Path, profiles: int) -> Iterator[Number]:
    if postgres.programs() is None:
        print('plant: no PostgreSQL on this machine: its figures are left out')
        return
    with postgres.running_server() as server:
        catalogue = Catalogue(folder, create=True, url=server.url, cell='bench')
        before = _database_bytes(catalogue)
        begin = time.perf_counter()
        for number in range(STORED):
            store_scan(catalogue, f's{number}', profiles)
        seconds = (time.perf_counter() - begin) / STORED
        size = (_database_bytes(catalogue) - before) / STORED
        note = f'{profiles} profiles, 2 views, {FEATURES_A_SCAN} features'
        yield Number('PostgreSQL, a scan', size / _KB, 'kB', None, note)
        yield Number('PostgreSQL, writing a scan', seconds, 's', None, 'all rows at once')
        year = 365 * CELLS * SCANS_A_DAY * size
        yield Number('PostgreSQL, a year', year / _GB, 'GB', None, f'{CELLS} cells')
        rate = update_rate(folder, server.url)
        note = f'{CELLS} cells at once; they and the server share this machine'
        yield Number('PostgreSQL, updates', rate, '1/s', None, note)
        mean = CELLS * SCANS_A_DAY * UPDATE_RATE * profiles / PICTURE_RATE / DAY_S
        yield Number('PostgreSQL, updates needed', mean, '1/s', None, 'mean of a day')
        note = f'where all {CELLS} cells scan at once; rows that wait delay no scan'
        yield Number('PostgreSQL, updates at most', CELLS * UPDATE_RATE, '1/s', None, note)
        catalogue.close()


def _database_bytes(catalogue: Catalogue) -> int:
    with catalogue.database.read() as connection:
        query = sql.text('SELECT pg_database_size(current_database())')
        return int(connection.execute(query).scalar_one())


def store_scan(catalogue: Catalogue, scan_id: str, profiles: int) -> None:
    """Add a scan with all its rows, as an orchestrator and a recorder do."""
    parameters = {f'parameter_{number}': 0.5 for number in range(80)}
    catalogue.add_scan(scan_id, 'bracket', 'fine', 'DONE', parameters)
    half = profiles // 2
    catalogue.add_profiles(scan_id, [location(seq, seq // half) for seq in range(profiles)])
    catalogue.add_result(scan_id, scan_id, {'counts': parameters})
    key = catalogue.scan(scan_id).key
    verdict = {'scan': key, 'number': 0, 'created': '2026-11-27T10:00:00Z', 'verdict': 'pass',
               'nominal': 'bracket.stl', 'sha256': '0' * 64}  # fmt: skip
    features = [
        {'scan': key, 'number': 0, 'feature': f'hole {number}', 'characteristic': 'diameter',
         'nominal': 0.01, 'measured': 0.01, 'uncertainty': 1e-5, 'tolerance': 5e-5,
         'verdict': 'pass'}
        for number in range(FEATURES_A_SCAN)
    ]  # fmt: skip
    with catalogue.database.write() as connection:
        connection.execute(sql.insert(VERDICTS).values(**verdict))
        connection.execute(sql.insert(FEATURES), features)


def location(seq: int, view: int) -> ProfileLocation:
    header = ProfileHeader(
        seq=seq, view=view, laser=view, angle=0.1 * seq, points=500, stamp_ns=START + seq
    )
    return ProfileLocation(
        header=header,
        topic='/ivfmc/profile',
        index=seq,
        log_time_ns=START + seq,
        chunk_offset=1_000_000 + seq,
    )


def update_rate(folder: Path, url: str) -> float:
    """Return the updates a second of all cells that write at once."""
    cells = [Catalogue(folder, url=url, cell=f'cell{number}') for number in range(CELLS)]
    for cell in cells:
        cell.add_scan('now', 'bracket', '', 'SCANNING', {})

    def write(cell: Catalogue) -> None:
        for seq in range(UPDATES):
            cell.add_profiles('now', [location(seq, 0)])

    begin = time.perf_counter()
    with ThreadPoolExecutor(CELLS) as pool:
        list(pool.map(write, cells))
    seconds = time.perf_counter() - begin
    for cell in cells:
        cell.close()
    return CELLS * UPDATES / seconds
