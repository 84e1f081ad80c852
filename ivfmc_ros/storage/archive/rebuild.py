# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rebuilds the rows of scans in the catalogue from their folders and bags alone."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from datetime import UTC
import glob
import json
from pathlib import Path
import re
from typing import Any

from mcap.records import Message
import yaml

from ivfmc_ros import files
from ivfmc_ros.errors import BagError
from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import MessageError
from ivfmc_ros.storage.bag.locate import PART_SUFFIX
from ivfmc_ros.storage.bag.recovery import IntactPart
from ivfmc_ros.storage.bag.recovery import known_channels
from ivfmc_ros.storage.bag.recovery import read_parts
from ivfmc_ros.storage.bag.writer import FILE_NAME
from ivfmc_ros.storage.catalogue.calibrations import add_calibration
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.catalogue.catalogue import CELL_FIELD
from ivfmc_ros.storage.catalogue.inspections import add_inspection
from ivfmc_ros.storage.catalogue.inspections import is_inspection
from ivfmc_ros.storage.catalogue.rows import ResultRow
from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.storage.messages.profile_header import read_profile_header
from ivfmc_ros.storage.messages.sensor_messages import POINT_CLOUD
from ivfmc_ros.storage.recording.profile_location import ProfileLocation

# A scan id begins with the time at which its folder was made.
_STAMP = re.compile(r'(\d{8}T\d{6})Z_(.+)')
# Stages of a scan of which no job file tells how it ended.
_UNKNOWN_STAGE, _UNKNOWN_CODE = 'FAILED', 'INTERRUPTED'


@dataclass(frozen=True, kw_only=True)
class RebuiltScan:
    """Number of profiles, results and inspections that were found for a scan."""

    scan_id: str
    profiles: int
    results: int
    inspections: int


def cell_folders(root: Path, cell: str) -> list[tuple[str, Path]]:
    """
    Return the cells whose scans are below a folder, each with the folder of its scans.

    root : ``{cell}`` in it stands for any name; without it, it is the folder of ``cell``
    """
    text = str(root)
    if CELL_FIELD not in text:
        return [(cell, root)]
    before, *rest = map(re.escape, text.split(CELL_FIELD))
    # later fields are the same name again
    pattern = f'{before}(?P<cell>[^/]+){"(?P=cell)".join(rest)}'
    places = '*'.join(map(glob.escape, str(root.relative_to(root.anchor)).split(CELL_FIELD)))
    found = []
    for folder in sorted(Path(root.anchor).glob(places)):
        match = re.fullmatch(pattern, str(folder))
        if match and folder.is_dir():
            found.append((match['cell'], folder))
    return found


def scan_folders(root: Path) -> list[Path]:
    """
    Return the folders of scans below a folder, in the order of their names.

    :raises FileError: the folder cannot be read
    """
    try:
        entries = sorted(path for path in root.iterdir() if path.is_dir())
    except OSError as error:
        raise FileError(f'{root}: cannot be read: {error.strerror or error}') from error
    return [path for path in entries if path.name[0] != '.' and _bag_file(path) is not None]


def rebuild_scan(catalogue: Catalogue, folder: Path) -> RebuiltScan:
    """
    Write the rows of a scan anew: all of them, or none if the bag cannot be read.

    Results that lie outside of the folder of the scan are kept if the catalogue has them.

    :raises BagError: the folder has no bag, or it cannot be read
    :raises CatalogueError: the catalogue cannot be written
    """
    file = _bag_file(folder)
    if file is None:
        raise BagError(f'{folder}: has neither {FILE_NAME} nor {FILE_NAME}{PART_SUFFIX}')
    locations = list(profile_locations(file))
    job, parameters = _job(folder), _parameters(folder)
    # a file beside the scans has no scan of the same name in another folder
    is_file = catalogue.database.is_file
    rows = catalogue.scans_of(folder.name)
    known = [row for row in rows if is_file or row.cell == catalogue.cell]
    cell = known[0].cell if known else catalogue.cell
    others = [
        result
        for row in known
        for result in catalogue.results(f'{row.cell}/{row.scan_id}')
        if result.folder != folder
    ]
    stamp = _STAMP.fullmatch(folder.name)
    part = str(parameters.get('part') or (stamp.group(2) if stamp else folder.name))
    values = {
        'scan_id': folder.name,
        'created': known[0].created if known else _created(folder, stamp),
        'stage': str(job.get('stage', _UNKNOWN_STAGE)),
        'code': str(job.get('code', _UNKNOWN_CODE)),
        'folder': folder.name,
        'parameters': json.dumps(parameters, default=str),
    }
    with catalogue.database.write() as connection:
        for row in known:
            catalogue.remove_rows(connection, row.key)
        recipe = str(parameters.get('recipe', ''))
        key = catalogue.insert_scan(connection, values, part=part, recipe=recipe, cell=cell)
        catalogue.insert_profiles(connection, key, locations)
    name = f'{cell}/{folder.name}'
    add_calibration(catalogue, name, folder)
    results, inspections = _add_results(catalogue, name, folder, others)
    return RebuiltScan(
        scan_id=folder.name, profiles=len(locations), results=results, inspections=inspections
    )


def _add_results(
    catalogue: Catalogue, name: str, folder: Path, others: list[ResultRow]
) -> tuple[int, int]:
    """Add the results and inspections of a scan, and return their numbers."""
    results = 0
    if (folder / 'report.json').is_file():
        document = _json(folder / 'report.json')
        catalogue.add_result(name, folder.name, {'counts': document.get('counts', {})})
        results += 1
    for result in others:
        catalogue.add_result(name, str(result.folder), result.summary)
        results += 1
    reports = [path for path in sorted(folder.rglob('report.json')) if is_inspection(_json(path))]
    return results, sum(add_inspection(catalogue, name, path) for path in reports)


def profile_locations(file: Path) -> Iterator[ProfileLocation]:
    """
    Yield the profiles of a file with their places; those of damaged chunks are left out.

    :raises BagError: the file cannot be read
    """
    channels, schemas = known_channels(file)
    decoders = {}
    for number, channel in channels.items():
        schema = schemas.get(channel.schema_id)
        if schema and cdr.full_name(schema.name) == POINT_CLOUD and _is_profile(channel.topic):
            text = schema.data.decode('utf-8', 'replace')
            decoders[number] = cdr.decoder(schema.name, schema.encoding, text)
    seen: Counter[int] = Counter()
    for part in read_parts(file):
        for record in part.records if isinstance(part, IntactPart) else ():
            if not isinstance(record, Message) or record.channel_id not in decoders:
                continue
            # other recorders may leave the sequence at 0
            index = max(record.sequence, seen[record.channel_id])
            seen[record.channel_id] = index + 1
            try:
                header = read_profile_header(decoders[record.channel_id](record.data))
            except (BagError, MessageError):
                continue
            yield ProfileLocation(
                header=header,
                topic=channels[record.channel_id].topic,
                index=record.sequence,
                log_time_ns=record.log_time,
                chunk_offset=part.offset,
            )


def _is_profile(topic: str) -> bool:
    return topic.rpartition('/')[2] == 'profile'


def _bag_file(folder: Path) -> Path | None:
    for name in (FILE_NAME, FILE_NAME + PART_SUFFIX):
        if (folder / name).is_file():
            return folder / name
    return None


def _created(folder: Path, stamp: re.Match[str] | None) -> str:
    if stamp:
        made = datetime.strptime(stamp.group(1), '%Y%m%dT%H%M%S').replace(tzinfo=UTC)
    else:
        made = datetime.fromtimestamp(folder.stat().st_mtime, UTC)
    return made.isoformat(timespec='milliseconds').replace('+00:00', 'Z')


def _job(folder: Path) -> dict[str, Any]:
    return _json(folder / 'job.json')


def _json(path: Path) -> dict[str, Any]:
    """Return a JSON object; an empty one where there is none."""
    try:
        document = json.loads(files.read_bytes(path))
    except (FileError, ValueError):
        return {}
    return document if isinstance(document, dict) else {}


def _parameters(folder: Path) -> dict[str, Any]:
    try:
        document = yaml.safe_load(files.read_bytes(folder / 'params.yaml'))
        return dict(document['orchestrator']['ros__parameters'])
    except (FileError, yaml.YAMLError, KeyError, TypeError, ValueError):
        return {}
