# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Responses of services as one JSON object: a result, or the code and detail of an error."""

from collections.abc import Mapping
import json
import math
from typing import Any

from ivfmc_ros.errors import ScanError

Answer = Mapping[str, Any]


def success_response(answer: Answer | None) -> str:
    """Return the JSON of a successful response: ``code`` OK and the given values."""
    return to_json({'code': 'OK', **(answer or {})})


def error_response(error: BaseException) -> str:
    """Return the JSON of a failed response: error code, detail, and the error's ``values``."""
    code = error.code if isinstance(error, ScanError) else 'INTERNAL'
    detail = str(error) if isinstance(error, ScanError) else describe(error)
    more = getattr(error, 'values', {})
    return to_json({'code': code, 'detail': detail, **more})


def to_json(answer: Answer) -> str:
    """Return strict JSON (RFC 8259): numbers that are not finite become null."""
    return json.dumps(_plain(answer), allow_nan=False)


def describe(error: BaseException) -> str:
    """Return an exception as one line; file and line number unless it is a ScanError."""
    if isinstance(error, ScanError):
        return str(error)
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    place = ''
    if trace is not None:
        place = f' ({trace.tb_frame.f_code.co_filename}:{trace.tb_lineno})'
    return ' '.join(f'{type(error).__name__}: {error}{place}'.split())


def _plain(value: Any) -> Any:
    """Convert NumPy numbers and arrays, tuples and paths to types that json can serialize."""
    if hasattr(value, 'tolist'):
        return _plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)
