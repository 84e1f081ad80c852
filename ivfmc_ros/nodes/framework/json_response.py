# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What services answer: one JSON object, with a code of ``errors`` when something went wrong."""

from collections.abc import Mapping
import json
import math
from typing import Any

from ivfmc_ros.errors import ScanError

Answer = Mapping[str, Any]


def ok(answer: Answer | None) -> str:
    """Return the JSON text of a good answer."""
    return text({'code': 'OK', **(answer or {})})


def refusal(error: BaseException) -> str:
    """Return the JSON text of an answer that says what went wrong."""
    code = error.code if isinstance(error, ScanError) else 'INTERNAL'
    detail = str(error) if isinstance(error, ScanError) else describe(error)
    more = getattr(error, 'values', {})
    return text({'code': code, 'detail': detail, **more})


def text(answer: Answer) -> str:
    """Return JSON as everybody reads it: a number that is not finite becomes null."""
    return json.dumps(_plain(answer), allow_nan=False)


def describe(error: BaseException) -> str:
    """Return one line about an exception; where it was raised unless it is a ScanError."""
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
    """Turn what json does not know (NumPy's numbers and arrays, paths) into what it does."""
    if hasattr(value, 'tolist'):
        return _plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)
