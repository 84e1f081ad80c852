# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Draws the run chart of a measured value, with its control and tolerance limits, as a picture."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from ivfmc_ros import files
from ivfmc_ros.storage.catalogue.statistics import Capability

_MM = 1e3
# Pixels per inch, and the size of the picture in inches.
_DPI = 110
_SIZE = (10.0, 4.8)


def write_run_chart(path: Path, found: Capability, title: str) -> None:
    """
    Write a run chart and a histogram; the format follows from the suffix of the file.

    :raises FileError: the file cannot be written
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=_SIZE, dpi=_DPI, layout='constrained')
    FigureCanvasAgg(figure)
    chart, histogram = figure.subplots(1, 2, sharey=True, width_ratios=(4, 1))
    values = found.values * _MM
    order = np.arange(1, len(values) + 1)
    chart.plot(order, values, '.-', color='0.25', linewidth=0.8, markersize=5)
    low, high = found.control
    is_out = (found.values < low) | (found.values > high)
    chart.plot(order[is_out], values[is_out], 'o', color='tab:orange', markersize=7,
               fillstyle='none', label='outside of the control limits')  # fmt: skip
    is_failed = (found.values < found.lower) | (found.values > found.upper)
    chart.plot(order[is_failed], values[is_failed], 'x', color='tab:red', markersize=8,
               label='outside of the tolerance')  # fmt: skip
    histogram.hist(values, bins='auto', orientation='horizontal', color='0.7')
    for axes in (chart, histogram):
        _draw_limits(axes, found)
    chart.set_xlabel('scan')
    chart.xaxis.get_major_locator().set_params(integer=True)
    chart.set_ylabel(f'{found.characteristic} (mm)')
    histogram.set_xlabel('scans')
    chart.legend(loc='upper center', bbox_to_anchor=(0.5, -0.14), ncols=3, fontsize=8)
    figure.suptitle(f'{title}: {found.feature}, {found.characteristic}\n{_figures(found)}')
    with files.atomic_file(path) as temporary:
        figure.savefig(temporary)


def _draw_limits(axes: Any, found: Capability) -> None:
    axes.axhline(found.mean * _MM, color='tab:blue', linewidth=1.0, label='mean')
    for name, limit in zip(('control limits', ''), found.control, strict=True):
        axes.axhline(limit * _MM, color='tab:orange', linestyle='--', linewidth=1.0,
                     label=name or None)  # fmt: skip
    limits = [limit for limit in (found.lower, found.upper) if math.isfinite(limit)]
    for number, limit in enumerate(limits):
        axes.axhline(limit * _MM, color='tab:red', linewidth=1.2,
                     label=None if number else 'tolerance')  # fmt: skip


def _figures(found: Capability) -> str:
    def text(value: float) -> str:
        return 'n/a' if math.isnan(value) else f'{value:.2f}'

    return (
        f'n = {len(found.values)}, mean {found.mean * _MM:.4f} mm, sigma '
        f'{found.sigma * _MM:.4f} mm, Cp {text(found.cp)}, Cpk {text(found.cpk)} '
        f'± {text(found.cpk_95)} (95 %), Pp {text(found.pp)}, Ppk {text(found.ppk)}'
    )
