# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
import pytest

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.bag.locate import find_files


def test_file_that_is_compressed_as_a_whole_is_named(tmp_path):
    folder = tmp_path / 'bag'
    folder.mkdir()
    (folder / 'bag_0.mcap.zstd').write_bytes(b'')
    for path in (folder, folder / 'bag_0.mcap.zstd'):
        with pytest.raises(BagError, match=r'bag_0\.mcap\.zstd: is compressed as a whole'):
            find_files(path)
