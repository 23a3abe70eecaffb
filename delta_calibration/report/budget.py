"""Uncertainty budget by GUM for a measured position and for a corrected one.

Contributions are covariances about the three axes of the base, (n, 3, 3) [m^2] at n poses. They
are independent of each other by construction (see `uncertainty.py` for frame and dimensions), so
that they add up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.report.about import NOT_STATED, STATED, About
from delta_calibration.report.examined import Examined
from delta_calibration.uncertainty import Parts, radius95

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Contribution:
    """One contribution to the uncertainty."""

    name: str
    kind: str  # A: by statistics of this session, B: as stated elsewhere (GUM 4.2, 4.3)
    origin: str
    measured: Array | None  # (n, 3, 3) [m^2] for a measured position; None: does not contribute
    corrected: Array | None  # (n, 3, 3) [m^2] for a corrected one


@dataclass(frozen=True)
class Budget:
    """Uncertainty budget: all contributions and the radius of corrected positions."""

    parts: tuple[Contribution, ...]
    widen: float  # factor for corrected positions, as their errors are not normal
    of_corrected: Array  # (n,) [m] 95 % radius of a corrected position about its target

    @property
    def measured(self) -> Array:
        """Covariance of measured positions, (n, 3, 3)."""
        return _sum([part.measured for part in self.parts])

    @property
    def corrected(self) -> Array:
        """Covariance of corrected positions, (n, 3, 3), without the factor `widen`."""
        return _sum([part.corrected for part in self.parts])

    @property
    def of_points(self) -> Array:
        """Expanded uncertainty of the 3-D error of each measured point, (n,) [m], 95 %."""
        return radius95(self.measured)


def _sum(parts: list[Array | None]) -> Array:
    there = [part for part in parts if part is not None]
    return np.asarray(np.sum(there, axis=0))


def standard(covariance: Array) -> Array:
    """Standard uncertainty about each axis, (3,) [m]: root of the mean variance of all poses."""
    return np.asarray(np.sqrt(np.diagonal(covariance, axis1=1, axis2=2).mean(axis=0)))


@dataclass(frozen=True)
class Stated:
    """Covariances by the stated uncertainties of instrument and thermometer, (n, 3, 3) [m^2]."""

    along: Array
    across: Array
    reflector: Array
    temperature: Array

    @property
    def whole(self) -> Array:
        """Sum of all."""
        return self.along + self.across + self.reflector + self.temperature


def stated_at(examined: Examined, about: About, places: Array) -> Stated:
    """Covariances by the stated uncertainties at places in the base, (n, 3) [m].

    Thermal expansion is counted from the middle of the measured poses, where the tracker's frame
    was fitted.
    """
    outer = _outer(examined.beam(places))
    along, across = about.tracker
    return Stated(
        along**2 * outer,
        across**2 * (np.eye(3) - outer),
        np.tile(about.reflector**2 * np.eye(3), (len(places), 1, 1)),
        about.growth**2 * _outer(places - examined.place),
    )


def certified(examined: Examined, about: About, places: Array) -> Array:
    """95 % radius about a target place within which a corrected tool point lies, (n,) [m].

    NaN outside the measured region.
    """
    return examined.radius_at(places, stated_at(examined, about, places).whole)


def budget_of(examined: Examined, about: About) -> Budget:
    """Compute the budget at the measured poses."""
    at, identified = examined.poses.conditions, examined.identified
    stated = stated_at(examined, about, examined.target).whole
    return Budget(
        (
            *_of_readings(examined),
            *_of_certificates(examined, about),
            *_of_machine(examined, identified.parts(at), identified.machine.parts(at)),
        ),
        identified.uncertainty.model.widen,
        identified.radius(at, stated),
    )


def _of_readings(examined: Examined) -> tuple[Contribution, ...]:
    """Contributions of the tracker's noise after averaging over the readings of a pose."""
    poses, noise = examined.poses, examined.noise
    along, across = examined.robot.tracker.sigmas(np.linalg.norm(poses.point, axis=1))
    outer = _outer(examined.beam(examined.measured))
    ways = (
        ("along", noise.radial_scale * along, outer),
        ("across", noise.transverse_scale * across, np.eye(3) - outer),
    )
    kind, origin = ("A", "scatter at rest") if noise.measured else ("B", "robot file")
    return tuple(
        Contribution(
            f"tracker's noise {way} the beam",
            kind,
            origin,
            (sigma**2 / poses.count)[:, None, None] * shape,
            None,
        )
        for way, sigma, shape in ways
    )


def _of_certificates(examined: Examined, about: About) -> tuple[Contribution, ...]:
    stated = stated_at(examined, about, examined.target)
    own = (stated.along, stated.across, stated.reflector, stated.temperature)
    return tuple(
        Contribution(name, "B", NOT_STATED, None, None)
        if name in about.silent
        else Contribution(name, "B", "stated", value, value)
        for name, value in zip(STATED, own, strict=True)
    )


def _of_machine(examined: Examined, seen: Parts, own: Parts) -> tuple[Contribution, ...]:
    """Contributions of the identified machine, by this session or by the earlier calibration."""
    earlier = ("B", "calibration")
    repeats = ("A", "repeated poses") if examined.noise.measured else ("B", "robot file")
    repeats = earlier if examined.stated else repeats
    residuals = earlier if examined.stated else ("A", "residuals")
    fitted = ("A", "fit") if examined.fit is not None or examined.seen else earlier
    return (
        Contribution(
            "repeatability of the joints", *repeats, own.repeatability, own.repeatability
        ),
        Contribution("play, side unknown", *residuals, None, own.play),
        Contribution("frame of the tracker", "A", "fit", seen.frame, own.frame),
        Contribution("dimensions as identified", *fitted, None, own.dimensions),
        Contribution("error of the model", *residuals, None, own.model),
    )


def _outer(ways: Array) -> Array:
    return np.asarray(ways[:, :, None] * ways[:, None, :])
