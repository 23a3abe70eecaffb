"""Poses that no model follows and that were set aside: whether they are outliers at all.

A reading of another reflector, or of one that was touched, is a gross error, and has nothing to
do with others. An edge of the workspace where all poses are off alike is no outlier but something
that the machine does there, and the fit has set aside what it could not follow.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.diagnosis.fitted import Fitted
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.residual_tests import misses_alike

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Aside:
    """What is known of the poses that were set aside as unlike the model."""

    alike: float | None  # p of as much likeness among outliers; None where they are too few
    rms: float  # [m] that they miss by, 3-D
    worst: Array | None  # (3,) [m] place in the base of the one that misses most

    @classmethod
    def of(cls, model: Fitted, rng: np.random.Generator) -> Aside:
        """Of a fit, which did not use them.

        Args:
            model: the machine with its terms.
            rng: of the draws of the test.
        """
        every = model.everything()
        whole, rows = every.beside, set_aside(model.evidence, every.evidence)
        if not rows.size:
            return cls(None, 0.0, None)
        missed = whole.missed(model.beside.best(model.misfit))[rows]
        size = np.linalg.norm(missed, axis=1)
        place = whole.chain.mechanism.position(whole.pose[rows])
        return cls(
            misses_alike(missed, whole.at.take(rows), rng),
            float(np.sqrt(np.mean(size**2))),
            place[int(np.argmax(size))],
        )


def set_aside(own: LinearizedModel, every: LinearizedModel) -> NDArray[np.intp]:
    """Rows of the poses that a fit has set aside as unlike it, and that another believes."""
    return np.flatnonzero((every.believed & ~own.believed)[: own.poses])
