# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The JSON schema of the answers of a cell, and the validation of answers by it."""

from functools import cache
import json
from pathlib import Path
from typing import Any

from jsonschema import Draft202012Validator

FILE = Path(__file__).resolve().parents[2] / 'config' / 'schemas' / 'answers-1.json'


@cache
def schema() -> dict[str, Any]:
    return dict(json.loads(FILE.read_text(encoding='utf-8')))


@cache
def _validator(name: str) -> Draft202012Validator:
    document = schema()
    pointer = name.replace('~', '~0').replace('/', '~1')
    return Draft202012Validator({**document, '$ref': f'#/$defs/{pointer}'})


def require_valid(service: str, success: bool, answer: dict[str, Any]) -> None:
    """
    Fail where the answer of a service does not have the form that the schema promises.

    A service that no node of the cell has, such as one of a test, may answer anything.
    """
    if success and service not in schema()['$defs']:
        return
    name = service if success else 'error'
    errors = [
        f'{error.json_path}: {error.message}' for error in _validator(name).iter_errors(answer)
    ]
    assert not errors, f'{service} (schema {name}): {errors}'


def require_valid_status(values: dict[str, str]) -> None:
    """Fail where the values of scan_status do not have the form that the schema promises."""
    errors = [error.message for error in _validator('scan_status').iter_errors(values)]
    assert not errors, errors
