# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bytes of an MCAP file that are read and written without the mcap library (mcap.dev/spec)."""

import struct

# Begins and ends a file.
MAGIC = b'\x89MCAP0\r\n'
# Opcode and content length of a record.
HEAD = struct.Struct('<BQ')
# Content of a chunk: start and end time, uncompressed size and CRC, length of the name of the
# compression; the name, the size of the data and the data follow.
CHUNK = struct.Struct('<QQQII')
