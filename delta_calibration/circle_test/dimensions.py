"""Selects dimensions that differ significantly from their nominal values and are no findings."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from delta_calibration.diagnosis.fitted import Fitted
from delta_calibration.diagnosis.verdict import Estimate

Index = NDArray[np.int64]

_CLEAR = 3.0  # standard errors; dimensions that deviate by less are not reported


def clear_dimensions(model: Fitted, rows: Index) -> Mapping[str, Estimate]:
    """Deviations of dimensions from nominal that are significant, the most significant first.

    Args:
        model: fitted, with the causes that were found.
        rows: entries of theta of the dimensions to test.
    """
    items = [model.bare.parameters.items[row] for row in rows]
    off = model.theta[rows] - [p.nominal for p in items]
    variance = np.diag(model.beside.known().covariance(model.misfit))[rows]
    std = np.sqrt(variance) * np.array([p.prior for p in items])
    order = np.argsort(-np.abs(off) / std)
    return {
        items[k].name: Estimate(float(off[k]), float(std[k]), items[k].unit)
        for k in order.tolist()
        if abs(off[k]) > _CLEAR * std[k]
    }
