# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A mesh aligned to its nominal, with deviations and uncertainty: input of all verdicts."""

from dataclasses import dataclass

import numpy as np

from ivfmc_ros.inspection.mesh_file import MeshBody
from ivfmc_ros.inspection.settings import InspectSettings
from ivfmc_ros.inspection.uncertainty import CalibrationModel
from ivfmc_ros.inspection.verdict import MAX_U_RATIO
from ivfmc_ros.model import Bools
from ivfmc_ros.model import Floats
from ivfmc_ros.model import Ints


@dataclass(frozen=True, eq=False, kw_only=True)
class VertexUncertainty:
    """
    Standard uncertainties of the deviations of n vertices by their sources, (n,) meters each.

    noise : of independent errors
    systematic : of errors that neighboring vertices share: edges and shadows in the stripe
    calibration : of errors of the cell that an alignment does not absorb
    conditions : of scale and temperature

    A source that is not known is NaN.
    """

    noise: Floats
    systematic: Floats
    calibration: Floats
    conditions: Floats

    @property
    def combined(self) -> Floats:
        """(n,) meters, combined standard uncertainty."""
        squares = self.noise**2 + self.systematic**2 + self.calibration**2 + self.conditions**2
        return np.asarray(np.sqrt(squares))

    def medians(self, chosen: Bools | Ints) -> dict[str, float]:
        """Return the median of each source over the chosen vertices."""
        return {
            'noise': float(np.median(self.noise[chosen])),
            'stripe bias': float(np.median(self.systematic[chosen])),
            'calibration': float(np.median(self.calibration[chosen])),
            'scale and temperature': float(np.median(self.conditions[chosen])),
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class Comparison:
    """
    A mesh aligned to its nominal. Positions are in the frame of the nominal.

    mesh : as measured, in its own frame
    normals : (n, 3) unit normals of the vertices, in the frame of the mesh
    nominal_from_mesh : (4, 4)
    vertices_xyz : (n, 3) meters, aligned and corrected to the reference temperature
    area : (n,) square meters of the surface that belongs to each vertex
    deviations : (n,) meters; NaN at vertices that were not measured
    uncertainty : of the deviations
    owner : (n,) index of the nominal's region of each vertex, or -1
    inner : (n,) bool, farther than ``settings.edge`` from the edges of the nominal
    model : displacement of points by the errors of the calibration
    """

    mesh: MeshBody
    normals: Floats
    nominal_from_mesh: Floats
    vertices_xyz: Floats
    area: Floats
    deviations: Floats
    uncertainty: VertexUncertainty
    owner: Ints
    inner: Bools
    model: CalibrationModel
    settings: InspectSettings

    @property
    def measured(self) -> Bools:
        """(n,) bool, vertices that were measured, not only filled in."""
        return np.asarray(np.isfinite(self.deviations))

    def is_measured_well(self, tolerance: float) -> Bools:
        """
        Return (n,) bool, which vertices decide about a tolerance (meters).

        Their expanded uncertainty is at most a third of it, or is not known at all.
        """
        combined = self.uncertainty.combined
        with np.errstate(invalid='ignore'):
            fine = ~(2.0 * combined > MAX_U_RATIO * tolerance)
        return self.measured & self.inner & fine
