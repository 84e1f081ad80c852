# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reading and writing of ``cell.yaml``, the calibration of lasers and turntable."""

from collections.abc import Callable
from dataclasses import dataclass
from dataclasses import field
from dataclasses import replace
from datetime import datetime
from datetime import UTC
from pathlib import Path
from typing import Any
from typing import TypeVar

import numpy as np
import yaml

from ivfmc_ros import files
from ivfmc_ros.cell.camera import Camera
from ivfmc_ros.cell.cell import Cell
from ivfmc_ros.cell.cell import Turntable
from ivfmc_ros.cell.covariance import CellCovariance
from ivfmc_ros.cell.fields import YamlMapping
from ivfmc_ros.cell.laser import Bow
from ivfmc_ros.cell.laser import LaserPlane
from ivfmc_ros.errors import CellError
from ivfmc_ros.file_kinds import CELL
from ivfmc_ros.file_kinds import require_kind

_T = TypeVar('_T')

_VERSION = 1
_NOTES = ('temperature_c', 'exposure', 'focus', 'board')
_TOP_KEYS = ('version', 'camera_frame', 'turntable', 'lasers', 'covariance', 'created', *_NOTES)
_TURNTABLE_KEYS = ('joint', 'camera_from_base', 'residual_rms', 'covariance', 'trigger_step')
_LASER_KEYS = (
    'name',
    'plane',
    'residual_rms',
    'stripe',
    'bow',
    'covariance',
    'volume',
    'thickness',
)


@dataclass(frozen=True, eq=False, kw_only=True)
class CellDraft:
    """
    Contents of a ``cell.yaml`` that may still lack lasers or turntable.

    Calibrations add them one by one.

    notes : the optional keys temperature_c, exposure, focus, board
    covariance : of all parameters together; a new laser or turntable ends its validity
    created : ISO 8601 time of the file; None for a changed draft
    :raises ValueError: a note has another key
    """

    turntable: Turntable | None = None
    lasers: tuple[LaserPlane, ...] = ()
    camera_frame: str = 'camera_optical_frame'
    notes: dict[str, Any] = field(default_factory=dict)
    covariance: CellCovariance | None = None
    created: str | None = None

    def __post_init__(self) -> None:
        for key in self.notes:
            if key not in _NOTES:
                raise ValueError(f'{key!r} is no note of a cell; known are {", ".join(_NOTES)}')

    def with_laser(self, laser: LaserPlane) -> 'CellDraft':
        """Return the draft with ``laser`` added; it replaces one of the same name."""
        names = [known.name for known in self.lasers]
        lasers = list(self.lasers)
        if laser.name in names:
            lasers[names.index(laser.name)] = laser
        else:
            lasers.append(laser)
        return replace(self, lasers=tuple(lasers), covariance=None, created=None)

    def with_turntable(self, turntable: Turntable) -> 'CellDraft':
        """Return the draft with the turntable set; its joint and trigger are wiring, and stay."""
        known = self.turntable
        if known is not None:
            step = turntable.trigger_step or known.trigger_step
            turntable = replace(turntable, joint=known.joint, trigger_step=step)
        return replace(self, turntable=turntable, covariance=None, created=None)

    def with_notes(self, **notes: Any) -> 'CellDraft':
        """Return the draft with notes added or replaced."""
        return replace(self, notes={**self.notes, **notes})

    def complete(self, camera: Camera, where: str) -> Cell:
        """
        Return the complete cell.

        where : the file; begins the message of an error
        :raises CellError: lasers or turntable are missing, or do not fit ``camera``
        """
        if self.turntable is None:
            raise CellError(f"{where}: turntable: is missing; run 'ivfmc calibrate turntable'")
        if not self.lasers:
            raise CellError(f"{where}: lasers: none; run 'ivfmc calibrate laser'")
        try:
            return Cell(
                camera=camera,
                turntable=self.turntable,
                lasers=self.lasers,
                camera_frame=self.camera_frame,
                notes=self.notes,
                covariance=self.covariance,
            )
        except CellError as error:
            raise CellError(f'{where}: {error}') from None


def load_cell(path: Path, camera: Camera) -> Cell:
    """
    Read a complete cell.

    :raises CellError: a key is missing, unknown or impossible; names the file and the key
    """
    return load_draft(path).complete(camera, str(path))


def load_draft(path: Path) -> CellDraft:
    """
    Read a cell that may lack its lasers or its turntable.

    :raises CellError: a key is unknown or impossible; names the file and the key
    """
    fields = YamlMapping.read(path)
    require_kind(path, fields.values, CELL)
    fields.require_known_keys(*_TOP_KEYS)
    if fields.required('version') != _VERSION:
        raise fields.error('version', f'{fields.required("version")!r} is not {_VERSION}')
    lasers = fields.required('lasers') if fields.has('lasers') else []
    if not isinstance(lasers, list):
        raise fields.error('lasers', 'must be a list')
    return CellDraft(
        turntable=_read_turntable(fields) if fields.has('turntable') else None,
        lasers=tuple(
            _read_laser(YamlMapping.of(f'{fields.where}: lasers[{index}]', laser))
            for index, laser in enumerate(lasers)
        ),
        camera_frame=fields.text('camera_frame'),
        notes={key: fields.values[key] for key in _NOTES if fields.has(key)},
        covariance=_read_covariance(fields) if fields.has('covariance') else None,
        created=fields.timestamp('created') if fields.has('created') else None,
    )


def save_draft(path: Path, draft: CellDraft) -> None:
    """
    Write a draft; ``created`` is the present time unless the draft is unchanged since reading.

    :raises FileError: the file cannot be written
    """
    now = datetime.now(UTC).replace(microsecond=0).isoformat().replace('+00:00', 'Z')
    document: dict[str, Any] = {'version': _VERSION, 'camera_frame': draft.camera_frame}
    if draft.turntable is not None:
        document['turntable'] = _turntable_document(draft.turntable)
    document['lasers'] = [_laser_document(laser) for laser in draft.lasers]
    if draft.covariance is not None:
        document['covariance'] = _covariance_document(draft.covariance)
    document['created'] = draft.created or now
    document.update(draft.notes)
    files.write_text(path, yaml.safe_dump(document, sort_keys=False, default_flow_style=None))


def save_cell(path: Path, cell: Cell) -> None:
    """
    Write a complete cell.

    :raises FileError: the file cannot be written
    """
    draft = CellDraft(
        turntable=cell.turntable,
        lasers=cell.lasers,
        camera_frame=cell.camera_frame,
        notes=dict(cell.notes),
        covariance=cell.covariance,
    )
    save_draft(path, draft)


def _read_turntable(top: YamlMapping) -> Turntable:
    fields = top.mapping('turntable')
    fields.require_known_keys(*_TURNTABLE_KEYS)
    return _with_location(
        fields,
        lambda: Turntable(
            joint=fields.text('joint'),
            camera_from_base=fields.array('camera_from_base', 16).reshape(4, 4),
            residual_rms=fields.number('residual_rms'),
            covariance=_optional_matrix(fields, 'covariance', 6, 6),
            trigger_step=fields.number('trigger_step') if fields.has('trigger_step') else 0.0,
        ),
    )


def _read_laser(fields: YamlMapping) -> LaserPlane:
    fields.require_known_keys(*_LASER_KEYS)
    plane = fields.array('plane', 4)
    stripe = fields.text('stripe')
    if stripe not in ('rows', 'columns'):
        raise fields.error('stripe', f'{stripe!r} is neither rows nor columns')
    return _with_location(
        fields,
        lambda: LaserPlane(
            name=fields.text('name'),
            normal=plane[:3],
            offset=float(plane[3]),
            stripe='rows' if stripe == 'rows' else 'columns',
            residual_rms=fields.number('residual_rms'),
            bow=_read_bow(fields.mapping('bow')) if fields.has('bow') else None,
            covariance=_optional_matrix(fields, 'covariance', 4, 4),
            volume=_optional_matrix(fields, 'volume', 2, 3),
            thickness=fields.number('thickness') if fields.has('thickness') else 0.0,
        ),
    )


def _read_covariance(top: YamlMapping) -> CellCovariance:
    fields = top.mapping('covariance')
    fields.require_known_keys('parameters', 'matrix', 'scale_u')
    names = fields.required('parameters')
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise fields.error('parameters', 'must be a list of names')
    count = len(names)
    return _with_location(
        top,
        lambda: CellCovariance(
            parameters=tuple(names),
            matrix=fields.array('matrix', count * count).reshape(count, count),
            scale_u=fields.number('scale_u') if fields.has('scale_u') else None,
        ),
    )


def _read_bow(fields: YamlMapping) -> Bow:
    fields.require_known_keys('center', 'along', 'coefficients')
    return Bow(
        center=fields.array('center', 3),
        along=fields.array('along', 3),
        coefficients=fields.array('coefficients', 3),
    )


def _optional_matrix(fields: YamlMapping, key: str, rows: int, columns: int) -> Any:
    if not fields.has(key):
        return None
    return fields.array(key, rows * columns).reshape(rows, columns)


def _with_location(fields: YamlMapping, build: Callable[[], _T]) -> _T:
    """Call ``build``, and prefix the message of its CellError with file and key."""
    try:
        return build()
    except CellError as error:
        text = str(error)
        raise (
            error if text.startswith(fields.where) else CellError(f'{fields.where}: {text}')
        ) from None


def _covariance_document(covariance: CellCovariance) -> dict[str, Any]:
    return {
        'parameters': list(covariance.parameters),
        'matrix': covariance.matrix.ravel().tolist(),
        'scale_u': covariance.scale_u,
    }


def _turntable_document(turntable: Turntable) -> dict[str, Any]:
    document: dict[str, Any] = {
        'joint': turntable.joint,
        'camera_from_base': turntable.camera_from_base.ravel().tolist(),
        'residual_rms': float(turntable.residual_rms),
    }
    if turntable.covariance is not None:
        document['covariance'] = turntable.covariance.ravel().tolist()
    if turntable.trigger_step:
        document['trigger_step'] = float(turntable.trigger_step)
    return document


def _laser_document(laser: LaserPlane) -> dict[str, Any]:
    document: dict[str, Any] = {
        'name': laser.name,
        'plane': [*laser.normal.tolist(), float(laser.offset)],
        'residual_rms': float(laser.residual_rms),
        'stripe': laser.stripe,
    }
    if laser.bow is not None:
        document['bow'] = {
            key: np.asarray(getattr(laser.bow, key)).tolist()
            for key in ('center', 'along', 'coefficients')
        }
    for key in ('covariance', 'volume'):
        values = getattr(laser, key)
        if values is not None:
            document[key] = values.ravel().tolist()
    if laser.thickness:
        document['thickness'] = float(laser.thickness)
    return document
