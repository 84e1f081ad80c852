# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What can go wrong, each with the code that commands and services answer."""


class ScanError(Exception):
    """
    Base of every error that a user of the scanner can cause or meet.

    ``str(error)`` is one line that names the file, topic or parameter and says what to do.
    """

    code = 'INTERNAL'

    def __init__(self, detail: str) -> None:
        super().__init__(' '.join(detail.split()))


class ParameterError(ScanError):
    """A setting has a value that cannot be used."""

    code = 'BAD_PARAMETER'


class FileError(ScanError):
    """A file or folder cannot be read, written or understood."""

    code = 'BAD_FILE'


class CellError(FileError):
    """A calibration file describes a cell that cannot exist or does not fit the camera."""

    code = 'BAD_CELL'


class CalibrationError(ScanError):
    """Pictures do not determine a calibration well enough."""

    code = 'CALIBRATION_REFUSED'


class BagError(FileError):
    """A bag is damaged or lacks a topic."""

    code = 'BAD_BAG'


class NoStripeError(ScanError):
    """No picture of a scan shows the laser stripe."""

    code = 'NO_STRIPE'


class GeometryError(ScanError):
    """Points do not determine the surface, pose or shape asked for."""

    code = 'DEGENERATE'
