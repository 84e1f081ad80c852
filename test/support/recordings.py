# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of profiles without pictures, for the tests of storage."""

import numpy as np

from ivfmc_ros.storage.bag.reader import open_bag
from ivfmc_ros.storage.bag.writer import BagWriter
from ivfmc_ros.storage.messages import cdr
from ivfmc_ros.storage.messages.point_clouds import POINT_FIELD_DTYPES
from ivfmc_ros.storage.messages.point_clouds import PROFILE_POINT_DTYPE
from ivfmc_ros.storage.messages.sensor_messages import POINT_CLOUD

START = 1_700_000_000_000_000_000
_CODES = {np.dtype(name): code for code, name in POINT_FIELD_DTYPES.items()}


def messages_of(path, **options):
    """Return topic, time of recording and data of all messages of a bag."""
    bag = open_bag(path, **options)
    return [(raw.topic, raw.log_time_ns, raw.data) for raw in bag.messages(list(bag.topics))]


def profile(seq, *, view=None, points=4):
    """Return the message of a profile; seq 0 to 4 are of view 0, the others of view 1."""
    records = np.zeros(points, dtype=PROFILE_POINT_DTYPE)
    records['x'] = np.arange(points) + 100.0 * seq
    records['seq'] = seq
    records['view'] = (0 if seq < 5 else 1) if view is None else view
    records['angle'] = 0.1 * seq
    return profile_message(records, START + seq * 10**8)


def profile_message(records, stamp_ns):
    """Return the message of a profile with the points ``records``, of PROFILE_POINT_DTYPE."""
    fields = [
        cdr.message(
            'sensor_msgs/msg/PointField',
            name=name,
            offset=PROFILE_POINT_DTYPE.fields[name][1],
            datatype=_CODES[PROFILE_POINT_DTYPE[name]],
            count=1,
        )
        for name in PROFILE_POINT_DTYPE.names
    ]
    return cdr.message(
        POINT_CLOUD,
        header=cdr.header(stamp_ns, 'turntable'),
        height=1,
        width=len(records),
        fields=fields,
        is_bigendian=False,
        point_step=PROFILE_POINT_DTYPE.itemsize,
        row_step=records.nbytes,
        data=records.view(np.uint8),
        is_dense=True,
    )


def write_profiles(folder, seqs, *, per_chunk, finish=True):
    """Write a recording of the profiles ``seqs``; without ``finish`` it is interrupted."""
    folder.mkdir(parents=True)
    bag = BagWriter(folder, chunk_bytes=None)
    for count, seq in enumerate(seqs, 1):
        bag.write('profile', POINT_CLOUD, cdr.encode(profile(seq)), START + seq * 10**8)
        if count % per_chunk == 0:
            bag.flush()
    if finish:
        bag.finish()
    bag.close()
