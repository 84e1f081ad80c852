# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rebuilds the rows of scans in the catalogue from their folders and bags alone."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from datetime import UTC
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
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.catalogue.inspections import add_inspection
from ivfmc_ros.storage.catalogue.inspections import is_inspection
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
    known = [row for row in catalogue.scans() if row.scan_id == folder.name]
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
            if row.cell == catalogue.cell:
                catalogue.remove_rows(connection, row.key)
        recipe = str(parameters.get('recipe', ''))
        key = catalogue.insert_scan(connection, values, part=part, recipe=recipe)
        catalogue.insert_profiles(connection, key, locations)
    return _add_results(catalogue, folder, len(locations), others)


def _add_results(
    catalogue: Catalogue, folder: Path, profiles: int, others: list[Any]
) -> RebuiltScan:
    results = 0
    if (folder / 'report.json').is_file():
        document = _json(folder / 'report.json')
        catalogue.add_result(folder.name, folder.name, {'counts': document.get('counts', {})})
        results += 1
    for result in others:
        catalogue.add_result(folder.name, str(result.folder), result.summary)
        results += 1
    reports = [path for path in sorted(folder.rglob('report.json')) if is_inspection(_json(path))]
    added = sum(add_inspection(catalogue, folder.name, path) for path in reports)
    return RebuiltScan(scan_id=folder.name, profiles=profiles, results=results, inspections=added)


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
