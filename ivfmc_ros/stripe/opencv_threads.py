# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How many threads OpenCV uses in a process that extracts stripes."""

import cv2


def use_one_thread() -> None:
    """
    Let OpenCV compute with one thread, in the whole process.

    The strips of an image around a stripe are small: to wake other threads takes longer than they
    save, and takes processor time from the other nodes or jobs.
    """
    cv2.setNumThreads(1)
