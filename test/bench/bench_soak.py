# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Soak: many short scans in a row by one cell of real processes; what each process keeps of each.

IVFMC_SOAK_SCANS sets the number of scans (200): a scan takes about 15 s.
"""

from collections.abc import Iterator
from collections.abc import Mapping
from collections.abc import Sequence
import os
from pathlib import Path
import shutil
import sys
import tempfile
from typing import NamedTuple

import numpy as np
from scipy import stats
from support.fault_cell import FaultCell
from support.fault_cell import FaultClient
from support.fault_effects import await_result
from support.fault_effects import SHORT
from support.fault_effects import start

from bench import at_least
from bench import at_most
from bench import Number

SCANS = int(os.environ.get('IVFMC_SOAK_SCANS', '200'))
# Scans after which caches, pools and pages of a process have been filled once: a share of all.
_WARM_SHARE = 0.25


class Holdings(NamedTuple):
    """What a process holds after a scan: memory of its own in kB, open files, threads."""

    memory_kb: float
    handles: float
    threads: float


def run() -> Iterator[Number]:
    client = FaultClient()
    codes: list[str] = []
    samples: list[dict[int, Holdings]] = []
    try:
        with tempfile.TemporaryDirectory() as name:
            cell = FaultCell(client, Path(name))
            cell.ensure()
            for number in range(SCANS):
                codes.append(await_result(cell, start(cell, SHORT)))
                samples.append({pid: _holdings(pid) for pid in cell.processes()})
                _say(number, codes[-1], samples[-1])
                _forget(cell, client)
            names = {pid: _name(pid) for pid in cell.processes()}
            cell.end()
            orphans = cell.orphans
    finally:
        client.close()
    bad = [code for code in codes if code != 'OK']
    yield Number('scans in a row', len(codes), '', at_least(SCANS))
    yield Number('scans that are not OK', len(bad), '', at_most(0), ', '.join(sorted(set(bad))))
    yield from slopes(samples, names)
    yield Number('processes left', orphans, '', at_most(0))


def slopes(
    samples: Sequence[Mapping[int, Holdings]], names: Mapping[int, str]
) -> Iterator[Number]:
    """
    Yield the slopes of the processes that lived through all scans, the worst one of each kind.

    Theil-Sen: a single collection of garbage in the middle changes nothing.
    """
    warm = samples[int(_WARM_SHARE * len(samples)) :]
    lasting = [pid for pid in names if all(pid in sample for sample in warm)]
    yield Number('processes that lasted', len(lasting), '', at_least(8), 'nodes and ivfmc up')
    bars = (('memory_kb', 'kB', 50.0), ('handles', '', 0.0), ('threads', '', 0.0))
    for field, unit, bar in bars:
        found = {
            pid: float(stats.theilslopes([getattr(sample[pid], field) for sample in warm]).slope)
            for pid in lasting
        }
        worst = max(found, key=lambda pid: found[pid])
        note = '; '.join(
            f'{names[pid]} {slope:+.2f}' for pid, slope in found.items() if abs(slope) >= 0.005
        )
        kind = field.partition('_')[0]
        name = f'{kind} a scan, worst process ({names[worst]})'
        yield Number(name, found[worst], unit, at_most(bar), note)


def _holdings(pid: int) -> Holdings:
    place = Path(f'/proc/{pid}')
    try:
        lines = (place / 'status').read_text(encoding='utf-8').splitlines()
        handles = len(list((place / 'fd').iterdir()))
    except OSError:
        # it has just ended
        return Holdings(np.nan, np.nan, np.nan)
    fields = dict(line.partition(':')[::2] for line in lines)
    return Holdings(float(fields['RssAnon'].split()[0]), handles, float(fields['Threads']))


def _name(pid: int) -> str:
    words = Path(f'/proc/{pid}/cmdline').read_bytes().decode().split('\0')
    module = words[words.index('-m') + 1] if '-m' in words else words[0]
    return f'{module.rpartition(".")[2]} {pid}'


def _forget(cell: FaultCell, client: FaultClient) -> None:
    """Drop what this process and the disk would collect of all scans."""
    client.forget()
    for folder in sorted(path for path in cell.scans.iterdir() if path.is_dir())[:-1]:
        for file in folder.glob('*.mcap'):
            file.unlink()
        for inner in (path for path in folder.iterdir() if path.is_dir()):
            shutil.rmtree(inner)


def _say(number: int, code: str, sample: Mapping[int, Holdings]) -> None:
    total = sum(one.memory_kb for one in sample.values()) / 1024
    text = f'soak: scan {number + 1} of {SCANS}: {code}, {total:.0f} MB in {len(sample)} processes'
    print(text, file=sys.stderr, flush=True)
