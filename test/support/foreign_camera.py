# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What camera drivers of other packages send.

Topics, QoS, stamps, encodings and parameters are those of the sources of usb_cam 0.8.1,
v4l2_camera 0.8.0 and camera_aravis2 1.2.0.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from rclpy.qos import qos_profile_sensor_data
from rclpy.qos import qos_profile_system_default
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Image

from ivfmc_ros.nodes.convert.images import octets
from ivfmc_ros.nodes.convert.stamps import header

EXPOSURE_S = 0.005
# Names of the parameters that the driver declares; those of v4l2_camera and camera_aravis2 depend
# on the camera, here a USB camera under Linux 6.8 and a GenICam camera.
_USB_CAM = (
    'camera_name camera_info_url framerate frame_id image_height image_width io_method '
    'pixel_format av_device_format video_device brightness contrast saturation sharpness gain '
    'auto_white_balance white_balance autoexposure exposure autofocus focus skip_device_check'
)
_V4L2_CAMERA = (
    'video_device camera_info_url camera_frame_id output_encoding pixel_format image_size '
    'auto_exposure exposure_time_absolute gain white_balance_automatic white_balance_temperature '
    'qos_overrides./ivfmc/image_raw.publisher.depth '
    'qos_overrides./ivfmc/image_raw.publisher.history'
)
_CAMERA_ARAVIS2 = (
    'guid stream_names camera_info_urls frame_id dynamic_parameters_yaml_url diagnostic_yaml_url '
    'diagnostic_publishing_rate verbose ImageFormatControl.PixelFormat '
    'AcquisitionControl.ExposureAuto AcquisitionControl.ExposureTime '
    'AcquisitionControl.AcquisitionFrameRateEnable AcquisitionControl.AcquisitionFrameRate '
    'AnalogControl.GainAuto AnalogControl.Gain TransportLayerControl.PtpEnable'
)


@dataclass(frozen=True, kw_only=True)
class Driver:
    """
    How a driver publishes.

    topics : of the images and of camera_info, before remapping
    qos : of both
    encoding : of the images
    stamp_delay : seconds from the start of the exposure to the stamp, least and greatest
    repeats : every so many images one is sent twice with the same stamp; 0: never
    parameters : names that it declares
    """

    topics: tuple[str, str] = ('image_raw', 'camera_info')
    qos: QoSProfile
    encoding: str
    stamp_delay: tuple[float, float]
    repeats: int = 0
    parameters: frozenset[str]


# usb_cam stamps the first packet of the frame, that is the end of the exposure, and publishes what
# it grabbed last by a timer of its own; the others stamp the arrival of the whole image.
DRIVERS = {
    'usb_cam': Driver(
        qos=QoSProfile(depth=100),
        encoding='yuv422_yuy2',
        stamp_delay=(EXPOSURE_S, EXPOSURE_S + 0.002),
        repeats=7,
        parameters=frozenset(_USB_CAM.split()),
    ),
    'v4l2_camera': Driver(
        qos=qos_profile_system_default,
        encoding='rgb8',
        stamp_delay=(0.06, 0.14),
        parameters=frozenset(_V4L2_CAMERA.split()),
    ),
    # the fork of tier4 with its parameter use_sensor_data_qos
    'v4l2_camera_sensor_data': Driver(
        qos=qos_profile_sensor_data,
        encoding='mono8',
        stamp_delay=(0.06, 0.14),
        parameters=frozenset(_V4L2_CAMERA.split()),
    ),
    'camera_aravis2': Driver(
        topics=('camera_driver/image_raw', 'camera_driver/camera_info'),
        qos=QoSProfile(depth=10),
        encoding='mono8',
        stamp_delay=(0.02, 0.03),
        parameters=frozenset(_CAMERA_ARAVIS2.split()),
    ),
}
# Greatest delays of the stamps: ``stamp_delay`` of the triangulator.
STAMP_DELAY_S = {name: round(driver.stamp_delay[1] + 0.01, 3) for name, driver in DRIVERS.items()}


def image_message(gray: np.ndarray, encoding: str, stamp_ns: int) -> Image:
    """Return a gray image as a driver sends it."""
    height, width = gray.shape
    data = encoded(gray, encoding)
    return Image(
        header=header(stamp_ns, 'camera_optical_frame'),
        height=height,
        width=width,
        encoding=encoding,
        step=len(data) // height,
        data=octets(data),
    )


def encoded(gray: np.ndarray, encoding: str) -> np.ndarray:
    """Return the bytes of a gray image in an encoding of sensor_msgs."""
    if encoding == 'rgb8':
        return np.ascontiguousarray(cv2.cvtColor(gray, cv2.COLOR_GRAY2RGB)).ravel()
    if encoding == 'yuv422_yuy2':
        # luminance of 16 to 235, as cameras send it
        luminance = np.rint(16.0 + gray * (219.0 / 255.0)).astype(np.uint8)
        return np.stack([luminance, np.full_like(gray, 128)], axis=-1).ravel()
    return gray.ravel()
