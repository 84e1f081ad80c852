# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Exceptions of the package; each has the error code that services and commands report."""


class ScanError(Exception):
    """
    Base of all errors that the package reports to its users.

    ``str(error)`` is one line that names the file, topic or parameter and what to do.

    code : stable identifier for programs
    """

    code = 'INTERNAL'

    def __init__(self, detail: str) -> None:
        super().__init__(' '.join(detail.split()))


class ParameterError(ScanError):
    """A setting or argument has an invalid value."""

    code = 'BAD_PARAMETER'


class FileError(ScanError):
    """A file or folder cannot be read, written or parsed."""

    code = 'BAD_FILE'


class DiskFullError(FileError):
    """There is too little free space for a scan."""

    code = 'DISK_FULL'


class CellError(FileError):
    """A calibration file is invalid, or does not fit the camera."""

    code = 'BAD_CELL'


class RecipeError(FileError):
    """A recipe is invalid, or there is none of this name."""

    code = 'BAD_RECIPE'


class CalibrationError(ScanError):
    """The images do not determine a calibration well enough."""

    code = 'CALIBRATION_REFUSED'


class BagError(FileError):
    """A bag is damaged or lacks a topic."""

    code = 'BAD_BAG'


class MessageError(ScanError):
    """A message is invalid: a field is missing, or the data do not match its description."""

    code = 'BAD_MESSAGE'


class NotReadyError(ScanError):
    """A node lacks an input that it needs first, such as its cell or a camera_info."""

    code = 'NOT_READY'


class NoStripeError(ScanError):
    """No image of a scan shows the laser stripe."""

    code = 'NO_STRIPE'


class LostProfilesError(ScanError):
    """Profiles of a scan have not been received by a node that needs them."""

    code = 'PROFILES_LOST'


class GeometryError(ScanError):
    """The points do not determine the surface, pose or shape to be computed."""

    code = 'DEGENERATE'


class AmbiguousError(GeometryError):
    """
    Several poses fit equally well, and none of them is chosen.

    values : further keys of a service's answer, such as motions
    """

    code = 'AMBIGUOUS'

    def __init__(self, detail: str, **values: object) -> None:
        super().__init__(detail)
        self.values = values


class DeviceError(ScanError):
    """A camera or motion controller did not do what it was asked to do."""

    code = 'DEVICE'


class ControllerLostError(DeviceError):
    """The motion controller cannot be reached, or no longer answers."""

    code = 'CONTROLLER_LOST'


class ControllerAlarmError(DeviceError):
    """The motion controller is locked or has lost its position; home it or clear the alarm."""

    code = 'CONTROLLER_ALARM'


class ControllerRefusedError(DeviceError):
    """The motion controller understood a command and refused it."""

    code = 'CONTROLLER_REFUSED'


class StoppedError(DeviceError):
    """A command ended because the motion was stopped."""

    code = 'STOPPED'


class CameraLostError(DeviceError):
    """The camera cannot be opened, or no longer delivers images."""

    code = 'CAMERA_LOST'


class BusyError(ScanError):
    """
    Another job is running, and only one can run at a time.

    values : further keys of a service's answer, such as scan_id
    """

    code = 'BUSY'

    def __init__(self, detail: str, **values: object) -> None:
        super().__init__(detail)
        self.values = values


class StateError(ScanError):
    """The request is not possible in the present stage of the scan, or without a scan."""

    code = 'WRONG_STATE'


class ResumeError(ScanError):
    """A scan that was interrupted cannot be resumed."""

    code = 'RESUME_REFUSED'


class CancelledError(ScanError):
    """A job was cancelled by request."""

    code = 'CANCELLED'


class TimeoutExceededError(ScanError):
    """An expected event did not occur before its deadline."""

    code = 'TIMEOUT'


class ClockJumpError(ScanError):
    """A clock that stamps messages jumped, so that images and table angles cannot be matched."""

    code = 'CLOCK_JUMPED'


class CatalogueError(FileError):
    """The catalogue of scans cannot be read or written, or has no such scan."""

    code = 'BAD_CATALOGUE'


class CatalogueBusyError(CatalogueError):
    """Another process holds a lock on the catalogue; the operation can be tried again."""


class HelperError(ScanError):
    """
    Another node of the cell is missing, does not answer, or reported an error.

    code : that the other node reported, such as CAMERA_LOST
    values : further keys of a service's answer
    """

    code = 'HELPER'

    def __init__(self, code: str, detail: str, **values: object) -> None:
        super().__init__(detail)
        self.code = code
        self.values = values
