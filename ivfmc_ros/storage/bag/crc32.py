# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
CRC-32 of two parts of a file, from those of the parts.

The CRC of a whole is linear in those of its parts: that of the first one is multiplied by x^8n
modulo the polynomial, n being the length of the second one in bytes (M. Adler, ``crc32_combine``
of zlib 1.2.12).
"""

from functools import cache
from functools import lru_cache

# Bits are in reverse order, as in zlib: the highest one is the coefficient of x^0.
_POLYNOMIAL = 0xEDB88320
_ONE, _X = 1 << 31, 1 << 30


def combined_crc(first: int, second: int, length: int) -> int:
    """
    Return the CRC of two parts, one behind the other.

    first, second : their CRCs, as of ``zlib.crc32``
    length : of the second one, bytes
    """
    return _product(_power_of_x(8 * length), first) ^ second


@lru_cache(maxsize=256)
def _power_of_x(exponent: int) -> int:
    power, bit = _ONE, 0
    while exponent:
        if exponent & 1:
            power = _product(_doubled_power(bit), power)
        exponent >>= 1
        bit += 1
    return power


@cache
def _doubled_power(bit: int) -> int:
    """Return x^(2^bit)."""
    if bit == 0:
        return _X
    half = _doubled_power(bit - 1)
    return _product(half, half)


def _product(a: int, b: int) -> int:
    """Multiply two polynomials modulo that of the CRC."""
    product = 0
    for position in range(31, -1, -1):
        if a >> position & 1:
            product ^= b
        b = b >> 1 ^ _POLYNOMIAL if b & 1 else b >> 1
    return product
