# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
import pytest

from ivfmc_ros.stripe.row_windows import row_windows


@pytest.mark.parametrize('width', [1, 3, 9])
def test_windows_are_those_of_numpy(width):
    whole = np.arange(12 * 40, dtype=np.uint8).reshape(12, 40)
    # not contiguous, as the crop of an image
    for array in (whole, whole[2:9, 5:14], whole[:, ::2], whole[3]):
        axis = array.ndim - 1
        assert np.array_equal(row_windows(array, width), sliding_window_view(array, width, axis))


def test_windows_are_a_view_that_can_be_written_only_where_asked():
    array = np.zeros((2, 6))
    with pytest.raises(ValueError, match='read-only'):
        row_windows(array, 3)[0, 0] = 1.0
    row_windows(array, 3, writeable=True)[np.arange(2), [0, 3]] = 1.0
    assert array.tolist() == [[1, 1, 1, 0, 0, 0], [0, 0, 0, 1, 1, 1]]


@pytest.mark.parametrize('width', [0, 7])
def test_windows_that_do_not_fit_are_refused(width):
    with pytest.raises(ValueError, match='do not fit into 6 columns'):
        row_windows(np.zeros((2, 6)), width)
