"""Check whether the poses that a fit set aside are outliers.

A reading of another reflector, or of one that was touched, is a gross error, independent of all
others. Poses at an edge of the workspace that all miss alike are no outliers: the machine has an
error there that the model could not follow, and the fit has set them aside.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.diagnosis.constants import LARGE, SAME_WAY
from delta_calibration.diagnosis.fitted import Fitted
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.residual_tests import misses_alike

Array = NDArray[np.float64]


_NEIGHBOURS = 4  # outliers next to one in joint positions


@dataclass(frozen=True)
class Aside:
    """Result of the check of the poses that were set aside as unlike the model."""

    alike: float | None  # p that neighbours among them miss as alike by chance; None if few
    rms: float  # [m] root mean square of their 3-D residuals
    worst: Array | None  # (3,) [m] position in the base of the pose with the largest residual

    @classmethod
    def of(cls, model: Fitted, rng: np.random.Generator) -> Aside:
        """Check the poses that a fit did not use.

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


def like_neighbours(missed: Array, joint: Array) -> NDArray[np.bool_]:
    """Which outliers miss as their neighbours among the outliers do, (k,); none if they are few.

    A cause that acts on few poses moves all of them by about as much, and neighbours the same way.
    A gross error does not; a single one among them would decide what explains them all.

    Args:
        missed: whitened residuals, (k, 3).
        joint: joint positions, (k, m); neighbours are nearest in them.
    """
    if len(missed) <= _NEIGHBOURS:
        return np.zeros(len(missed), dtype=bool)
    size = np.linalg.norm(missed, axis=1)
    apart = np.linalg.norm(joint[:, None] - joint, axis=-1)
    np.fill_diagonal(apart, np.inf)
    near = np.argsort(apart, axis=1)[:, :_NEIGHBOURS]
    along = missed / np.maximum(size, 1e-300)[:, None]
    same = np.einsum("ki,ki->k", along, np.median(along[near], axis=1)) > SAME_WAY
    usual = float(np.median(size))
    return np.asarray(same & (size < LARGE * usual) & (size * LARGE > usual))


def set_aside(own: LinearizedModel, every: LinearizedModel) -> NDArray[np.intp]:
    """Rows of the poses that one fit (`own`) sets aside and another one (`every`) uses."""
    return np.flatnonzero((every.believed & ~own.believed)[: own.poses])
