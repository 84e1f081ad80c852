# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from support.synthetic import small_camera

from ivfmc_ros.errors import CellError
from ivfmc_ros.storage.messages.rectified import require_raw_images

DISTORTED = replace(small_camera(), distortion=np.array([-0.2, 0.05, 0.0, 0.0, 0.0]))
PINHOLE = replace(small_camera(), distortion=np.zeros(5))


@pytest.mark.parametrize('topic', ['/c/image_rect', '/c/image_rect_color', '/c/rect/image'])
def test_rectified_images_with_the_distortion_of_the_raw_ones_are_refused(topic):
    with pytest.raises(CellError, match=f'{topic}: the images are rectified'):
        require_raw_images(topic, DISTORTED)
    require_raw_images(topic, PINHOLE)


@pytest.mark.parametrize('topic', ['/c/image_raw', '/direct/image', '/rectory/image_raw'])
def test_raw_images_are_not_refused(topic):
    require_raw_images(topic, DISTORTED)
