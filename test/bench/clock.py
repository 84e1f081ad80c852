# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How long a picture takes, in a process of its own that has one thread.

A BLAS that another task of this process woke before would spin on, and its waiting would be
counted as work.
"""

from dataclasses import replace
import json
import os
import subprocess
import sys
import time

import cv2
import numpy as np

from bench import stripes
from ivfmc_ros.stripe.extract import extract
from ivfmc_ros.stripe.extract import ExtractSettings

SPECKLED = stripes.Case(2.5, 180.0, 2.0, 45.0, 0.15)
_ONE_THREAD = ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS', 'MKL_NUM_THREADS')


def times():
    """Return the median milliseconds a picture of each task, all tasks in turn in every round."""
    environment = {
        **os.environ,
        'PYTHONPATH': os.pathsep.join(sys.path),
        **dict.fromkeys(_ONE_THREAD, '1'),
    }
    done = subprocess.run(
        [sys.executable, '-m', 'bench.clock'], env=environment, stdout=subprocess.PIPE, check=True
    )
    return json.loads(done.stdout)


def tasks():
    """Return by name what is done to a picture, and to which pictures."""
    plain = [image for image, _ in stripes.pictures(SPECKLED, 4, 3)]
    other = [image for image, _ in stripes.pictures(replace(SPECKLED, height=120.0), 4, 4)]
    double = [np.maximum(one, two[:, ::-1]) for one, two in zip(plain, other, strict=True)]
    wide = [image for image, _ in stripes.pictures(replace(SPECKLED, sigma=5.0), 4, 5)]
    no_path = ExtractSettings(path=False)
    return {
        'argmax': (lambda image: image.argmax(axis=1), plain),
        'default': (lambda image: extract(image, settings=no_path), plain),
        'path': (extract, double),
        'wide': (extract, wide),
        'horus': (stripes.horus, plain),
    }


def measure(rounds=60):
    seconds = {}
    todo = tasks()
    for turn in range(rounds + 3):
        for name, (work, images) in todo.items():
            image = images[turn % len(images)]
            start = time.process_time()
            work(image)
            # the first rounds warm caches
            if turn >= 3:
                seconds.setdefault(name, []).append(time.process_time() - start)
    return {name: 1e3 * float(np.median(values)) for name, values in seconds.items()}


if __name__ == '__main__':
    cv2.setNumThreads(1)
    print(json.dumps(measure()))
