# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Writes 3MF files, which state their unit, with lib3mf of the 3MF Consortium."""

from importlib.util import find_spec
import json
from typing import Any
from typing import BinaryIO

import numpy as np

from ivfmc_ros.errors import ParameterError
from ivfmc_ros.meshing.geometry.topology import boundary_edges
from ivfmc_ros.model import BASE
from ivfmc_ros.model import BRIDGED
from ivfmc_ros.model import FILLED
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints
from ivfmc_ros.model import MEASURED
from ivfmc_ros.model import Mesh

_NAMESPACE = 'urn:ivfmc_ros'
_KINDS = {MEASURED: 'measured', BRIDGED: 'bridged', BASE: 'base', FILLED: 'filled'}
_UNITS = {'m': 'Meter', 'mm': 'MilliMeter', 'inch': 'Inch'}


def require() -> None:
    """
    Check that lib3mf is installed. There are no wheels for ARM.

    :raises ParameterError: it is not
    """
    if find_spec('lib3mf') is None:
        raise ParameterError('3mf: needs lib3mf, which is not installed: pip install lib3mf')


def write(stream: BinaryIO, mesh: Mesh, vertices: Floats, unit: str) -> None:
    """
    Write a mesh as one object: of type model if it is closed, else of type surface.

    vertices : (n, 3), in ``unit``
    The metadata entry ``uncertainty`` (JSON) states the uncertainty of the vertices.

    unit : m, mm or inch
    :raises ParameterError: lib3mf is not installed
    """
    require()
    import lib3mf

    model = lib3mf.get_wrapper().CreateModel()
    model.SetUnit(getattr(lib3mf.ModelUnit, _UNITS[unit]))
    model.GetMetaDataGroup().AddMetaData(
        _NAMESPACE, 'uncertainty', json.dumps(_uncertainty(mesh)), 'xs:string', False
    )
    item = model.AddMeshObject()
    item.SetName('ivfmc_ros')
    item.SetGeometry(
        _array(lib3mf.Position, vertices, '<f4'), _array(lib3mf.Triangle, mesh.faces, '<u4')
    )
    closed = not len(boundary_edges(mesh.faces))
    item.SetType(getattr(lib3mf.ObjectType, 'Model' if closed else 'Surface'))
    model.AddBuildItem(item, lib3mf.get_wrapper().GetIdentityTransform())
    stream.write(bytes(model.QueryWriter('3mf').WriteToBuffer()))


def _uncertainty(mesh: Mesh) -> dict[str, Any]:
    """Return median and 95 % of sigma and of the systematic sigma, and the faces of each kind."""
    found: dict[str, Any] = {'unit': 'm'}
    for name, values in (('sigma', mesh.sigma), ('systematic', mesh.systematic)):
        known = np.empty(0) if values is None else values[np.isfinite(values)]
        median, p95 = np.percentile(known, (50, 95)).tolist() if len(known) else (None, None)
        found[name] = {'median': median, 'p95': p95, 'vertices': len(known)}
    kind = np.full(len(mesh.faces), MEASURED) if mesh.kind is None else mesh.kind
    found['faces'] = {name: int(np.count_nonzero(kind == k)) for k, name in _KINDS.items()}
    return found


def _array(kind: Any, rows: Floats | Ints, dtype: str) -> Any:
    """Return (n, 3) numbers as a ctypes array of a structure of lib3mf."""
    return (kind * len(rows)).from_buffer_copy(np.ascontiguousarray(rows, dtype=dtype))
