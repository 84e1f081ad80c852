# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Tokens of servers that other computers can reach."""

import ipaddress
from pathlib import Path

from ivfmc_ros.errors import FileError
from ivfmc_ros.errors import ParameterError

_MIN_TOKEN = 16


def read_token(path: Path | None) -> str:
    """
    Return the token in a file, '' without a file.

    :raises FileError: the file cannot be read
    :raises ParameterError: the token is too short, or has unprintable characters
    """
    if path is None:
        return ''
    try:
        token = path.read_text(encoding='ascii').strip()
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(f'{path}: cannot be read as a token: {error}') from error
    if len(token) < _MIN_TOKEN or not token.isprintable() or set(token) & set(' ;,"\\'):
        raise ParameterError(
            f'{path}: a token has at least {_MIN_TOKEN} printable characters, no space, quote, '
            'comma, semicolon or backslash; make one with openssl rand -hex 24'
        )
    return token


def require_token(address: str, token: str, option: str) -> None:
    """
    Refuse an address that other computers can reach without a token.

    option : that names the file of the token, for the error
    :raises ParameterError: the token is missing, or the address is no IP address
    """
    try:
        is_loopback = ipaddress.ip_address(address).is_loopback
    except ValueError:
        raise ParameterError(f'address {address!r}: is no IP address') from None
    if not is_loopback and not token:
        raise ParameterError(f'address {address}: other computers can reach it; name a {option}')
