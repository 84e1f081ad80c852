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


class MessageError(ScanError):
    """A message cannot be understood: a field is missing, or its data are not what it says."""

    code = 'BAD_MESSAGE'


class NotReadyError(ScanError):
    """A node lacks something that it needs first, such as its cell or a camera_info."""

    code = 'NOT_READY'


class NoStripeError(ScanError):
    """No picture of a scan shows the laser stripe."""

    code = 'NO_STRIPE'


class LostProfilesError(ScanError):
    """Profiles that were taken have not come where they are needed."""

    code = 'PROFILES_LOST'


class GeometryError(ScanError):
    """Points do not determine the surface, pose or shape asked for."""

    code = 'DEGENERATE'


class AmbiguousError(GeometryError):
    """
    Several poses fit equally well, and none of them is chosen.

    values : stand beside code and detail in the answer, such as poses
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
    """A command ended because somebody stopped the motion."""

    code = 'STOPPED'


class CameraLostError(DeviceError):
    """The camera cannot be opened, or gives no pictures any more."""

    code = 'CAMERA_LOST'


class BusyError(ScanError):
    """
    A scan is running, and only one can.

    values : stand beside code and detail in the answer, such as scan_id
    """

    code = 'BUSY'

    def __init__(self, detail: str, **values: object) -> None:
        super().__init__(detail)
        self.values = values


class StateError(ScanError):
    """What was asked for is not possible at this stage of a scan, or without one."""

    code = 'WRONG_STATE'


class CancelledError(ScanError):
    """A scan was ended before its time because somebody asked for it."""

    code = 'CANCELLED'


class TimeoutExceededError(ScanError):
    """Something did not happen before its deadline."""

    code = 'TIMEOUT'


class CatalogueError(FileError):
    """The catalogue of scans cannot be read or written, or does not know a scan."""

    code = 'BAD_CATALOGUE'


class CatalogueBusyError(CatalogueError):
    """Somebody else holds the catalogue; what failed can be tried again."""


class HelperError(ScanError):
    """
    A part of the cell is missing, silent, or answered that it could not do its work.

    code : of the part that knows best what went wrong, such as CAMERA_LOST
    values : stand beside code and detail in the answer
    """

    code = 'HELPER'

    def __init__(self, code: str, detail: str, **values: object) -> None:
        super().__init__(detail)
        self.code = code
        self.values = values
