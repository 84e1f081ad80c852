# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What services answer: one JSON object, with a code of ``errors`` when something went wrong."""

from collections.abc import Mapping
import json
from typing import Any

from ivfmc_ros.errors import ScanError

Answer = Mapping[str, Any]


def ok(answer: Answer | None) -> str:
    """Return the JSON text of a good answer."""
    return json.dumps({'code': 'OK', **(answer or {})}, default=_plain)


def refusal(error: BaseException) -> str:
    """Return the JSON text of an answer that says what went wrong."""
    code = error.code if isinstance(error, ScanError) else 'INTERNAL'
    detail = str(error) if isinstance(error, ScanError) else describe(error)
    more = getattr(error, 'values', {})
    return json.dumps({'code': code, 'detail': detail, **more}, default=_plain)


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
    return value.tolist() if hasattr(value, 'tolist') else str(value)
