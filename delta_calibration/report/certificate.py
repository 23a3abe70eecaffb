"""Calibration certificate: dimensions, errors, their uncertainty, and conformity with a tolerance.

For the engineer who signs it and the quality manager who reads it; the statistical details are in
the appendix.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import DataError
from delta_calibration.lazy import cached_property
from delta_calibration.report.about import NOT_STATED, About
from delta_calibration.report.budget import Budget, budget_of, certified
from delta_calibration.report.decision import Decision, decided, of_all
from delta_calibration.report.examined import Examined
from delta_calibration.report.provenance import Provenance

Array = NDArray[np.float64]

MM = 1e3
COVERAGE = 2.0  # coverage factor k of the dimensions
# largest standard error of an identified dimension, over its tolerance (one standard deviation)
IDENTIFIED = 0.5
_PLACES = 400  # places sampled in the region for the certified uncertainty
_SEED = 1


@dataclass(frozen=True)
class Dimension:
    """One dimension of the machine, all values in its unit."""

    name: str
    unit: str  # m, rad, ...
    nominal: float
    value: float
    expanded: float  # expanded uncertainty U, k = 2
    tolerance: float  # one standard deviation of the parts (prior)
    identified: bool


@dataclass(frozen=True)
class Certificate:
    """Content of a calibration certificate; numbers in SI units."""

    examined: Examined
    about: About
    provenance: Provenance

    @cached_property
    def budget(self) -> Budget:
        """Uncertainty budget at the measured poses."""
        return budget_of(self.examined, self.about)

    @property
    def error_before(self) -> Array:
        """3-D error before the calibration: distance from the commanded position, (n,) [m]."""
        return np.asarray(np.linalg.norm(self.examined.before, axis=1))

    @property
    def error_after(self) -> Array:
        """3-D error with corrected commands, (n,) [m]."""
        return np.asarray(np.linalg.norm(self.examined.after, axis=1))

    @cached_property
    def places(self) -> Array:
        """Measured targets, and tool points sampled in the region with its corners, (k, 3) [m]."""
        rng = np.random.default_rng(_SEED)
        inside = self.examined.region.sample(_PLACES, 0.0, rng)
        return np.concatenate([self.examined.target, self.examined.tools(inside)])

    @cached_property
    def certified(self) -> Array:
        """Uncertainty (95 %) of corrected positions at `places`, (k,) [m]; NaN out of reach.

        Raises:
            DataError: no place lies in the calibrated region.
        """
        found = certified(self.examined, self.about, self.places)
        if not np.isfinite(found).any():
            raise DataError(
                f"{self.examined.poses.source}: no measured place is in the calibrated region: "
                "does the calibration belong to another part of the workspace?"
            )
        return found

    @property
    def points(self) -> tuple[Decision, ...] | None:
        """Decision of every pose; None without a tolerance.

        A pose that was set aside is not decided, nor is one that would pass by a calibration made
        from its own reading.
        """
        if self.about.tolerance is None:
            return None
        judged = decided(self.error_after, self.budget.of_points, self.about.tolerance)
        own = self.examined.seen
        return tuple(
            one if counts and not (own and one is Decision.PASS) else Decision.NOT_DECIDED
            for one, counts in zip(judged, self.examined.believed, strict=True)
        )

    @property
    def decision(self) -> Decision | None:
        """Decision of the machine; None without a tolerance."""
        return None if self.points is None else of_all(self.points)

    @cached_property
    def dimensions(self) -> tuple[Dimension, ...]:
        """Dimensions in the order of the robot's model."""
        identified = self.examined.identified
        own = identified.chain.layout.geometry
        std = np.sqrt(np.maximum(np.diag(identified.uncertainty.covariance), 0.0))[own]
        items = identified.chain.parameters.items[own]
        return tuple(
            Dimension(
                p.name,
                p.unit,
                p.nominal,
                float(value),
                COVERAGE * float(s),
                p.prior,
                bool(s < IDENTIFIED * p.prior),
            )
            for p, value, s in zip(items, identified.theta[own], std, strict=True)
        )

    def as_dict(self) -> Mapping[str, Any]:
        """Convert to JSON data; see schemas/certificate.json."""
        examined, budget = self.examined, self.budget
        points = self.points
        tolerance = self.about.tolerance
        return {
            "schema": 1,
            "about": dict(self.about.given),
            "robot": {"name": examined.robot.name, "sha256": examined.robot.hash},
            "session": {
                "name": self.provenance.session,
                "sha256": self.provenance.session_sha256,
                "poses": len(examined.poses),
                "set_aside": sum(examined.poses.rejected.counts().values()),
            },
            "calibration_sha256": self.provenance.calibration_sha256 or None,
            "errors_held_out": not examined.seen,
            "tolerance_mm": None if tolerance is None else MM * tolerance,
            "decision_rule": RULE,
            "decision": None if self.decision is None else self.decision.value,
            "dimensions": [
                {
                    "name": d.name,
                    "unit": d.unit,
                    "nominal": d.nominal,
                    "identified": d.value if d.identified else None,
                    "deviation": d.value - d.nominal if d.identified else None,
                    "U": d.expanded if d.identified else None,
                }
                for d in self.dimensions
            ],
            "points": [
                {
                    "number": k + 1,
                    "x_mm": _mm(examined.target[k]),
                    "before_mm": _mm(examined.before[k]),
                    "after_mm": _mm(examined.after[k]),
                    "U_mm": MM * float(budget.of_points[k]),
                    "believed": bool(examined.believed[k]),
                    "decision": None if points is None else points[k].value,
                }
                for k in range(len(examined.poses))
            ],
            "budget": [
                {
                    "name": part.name,
                    "kind": part.kind,
                    "origin": part.origin,
                    "measured_um": _um(part.measured),
                    "corrected_um": _um(part.corrected),
                }
                for part in budget.parts
            ],
            "widened": budget.widen,
            "certified": {
                "places": int(np.isfinite(self.certified).sum()),
                "u95_largest_mm": MM * float(np.nanmax(self.certified)),
                "u95_median_mm": MM * float(np.nanmedian(self.certified)),
            },
        }

    @property
    def number(self) -> str:
        """Number of the certificate as given; else empty."""
        given = self.about.text("number")
        return "" if given == NOT_STATED else given


RULE = (
    "ISO 14253-1 with the whole expanded uncertainty U (95 %): a point passes if error + U <= "
    "tolerance, fails if error - U > tolerance, and is undecided otherwise; the machine passes "
    "if every point does"
)


def _mm(vector: Array) -> list[float]:
    return [MM * float(value) for value in vector]


def _um(covariance: Array | None) -> list[float] | None:
    if covariance is None:
        return None
    return [1e6 * float(u) for u in np.sqrt(np.diagonal(covariance, axis1=1, axis2=2).mean(0))]
