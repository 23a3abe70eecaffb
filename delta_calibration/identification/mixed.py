"""One least-squares fit over observations of different kinds, priors as rows.

    minimise  sum_kinds |missed / sigma|^2 + sum_prior ((g - g_0) / prior)^2

over the geometry and, if any kind depends on it, the frame of the device. The unknowns are scaled
by what is expected of them, so that a step is of the order of one. What neither observations nor
priors set is named and has no standard error; it stays near where it was drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from delta_calibration.errors import DataError, InputError
from delta_calibration.geometry import Frame
from delta_calibration.identification.observability import Observability, observe
from delta_calibration.identification.observations import Machine, Observation, unknowns
from delta_calibration.mechanisms import Mechanism
from delta_calibration.theta import frame_names

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_STEP = 1e-3  # typical size of an unknown without prior [m, rad]
_NONE = 1e-8  # singular values under this share of the largest are none
_PART = 1e-6  # of an unknown in a combination that does not show
_SPARE = 1e-6  # degrees of freedom under which nothing is left to judge the noise by
FRAME_NAMES = frame_names("device")


@dataclass(frozen=True)
class MixedFit:
    """A machine as measured, and how much of it the measurements say.

    `told` counts the combinations of unknowns that the observations set, between none and all of
    them: one that they leave as uncertain as its prior had it counts nothing.
    """

    machine: Machine
    names: tuple[str, ...]  # of the fitted unknowns, (F,)
    covariance: Array  # (F, F) by noise and priors
    prior: Array  # (F,) inf where there is none or none was used
    observability: Observability  # of the observations alone
    missed: tuple[Array, ...]  # of each observation, (n, d) [m, rad, px]
    unset: tuple[str, ...]  # unknowns with a part that neither observations nor priors set
    told: float
    chi_square: float  # per degree of freedom, of the stated noise; inf where none is left

    @property
    def std(self) -> Array:
        """Standard errors, (F,); infinite for what is not set."""
        unset = np.isin(self.names, self.unset)
        return np.where(unset, np.inf, np.sqrt(np.diag(self.covariance)))

    def rms(self, observation: int, numbers: slice = slice(None)) -> float:
        """Root mean square of the distance missed by an observation [m, rad, px]."""
        missed = self.missed[observation][:, numbers]
        return float(np.sqrt(np.mean(np.sum(missed**2, axis=1))))


def fit_observations(
    mechanism: Mechanism,
    observations: Sequence[Observation],
    frame: Frame | None = None,
    free: Mask | None = None,
    priors: bool = True,
) -> MixedFit:
    """Geometry and frame that all observations together ask for.

    Args:
        mechanism: drawing and priors.
        observations: any kinds, at least one.
        frame: `T_device_base` to start from; needed where a kind depends on it.
        free: which geometry parameters are fitted, (p,); all where not given.
        priors: whether what is expected of the parts takes part.

    Raises:
        InputError: no observation, no frame where one is needed, or two devices at unknown
            places.
        DataError: fewer numbers than unknowns without priors, joints out of the nominal machine's
            reach, points that its camera cannot see, or no rest.
    """
    problem = _problem(mechanism, observations, frame, free, priors)
    found = least_squares(problem.rows, np.zeros(problem.size), problem.slopes, xtol=1e-12)
    if not found.success:
        raise DataError(f"the fit found no rest: {found.message}")
    machine = problem.machine(found.x)
    white = problem.slopes(found.x)
    data = white[: len(white) - problem.size]
    names = tuple(np.array(mechanism.parameters.names + FRAME_NAMES)[problem.free].tolist())
    spread, loose = _spread(white)
    told = float(np.trace(spread @ data.T @ data))
    squares, degrees = np.sum(problem.rows(found.x)[: len(data)] ** 2), len(data) - told
    return MixedFit(
        machine=machine,
        names=names,
        covariance=problem.scale[:, None] * spread * problem.scale,
        prior=problem.prior,
        observability=observe(data[:, None] / problem.scale, problem.scale, names),
        missed=tuple(o.missed(machine) for o in observations),
        unset=tuple(name for name, yes in zip(names, loose, strict=True) if yes),
        told=told,
        chi_square=float(squares / degrees) if degrees > _SPARE else np.inf,
    )


def _spread(white: Array) -> tuple[Array, Mask]:
    """Covariance (F, F) by whitened slopes, and which unknowns have a part that does not show."""
    size = np.linalg.norm(white, axis=0)
    size[size == 0.0] = 1.0
    _, values, across = np.linalg.svd(white / size, full_matrices=False)
    shows = values > _NONE * values[0]
    half = across[shows] / values[shows, None]
    loose = 1.0 - np.sum(across[shows] ** 2, axis=0) > _PART
    return half.T @ half / np.outer(size, size), loose


@dataclass(frozen=True)
class _Problem:
    start: Machine
    observations: tuple[Observation, ...]
    free: Mask  # (p + 6,)
    prior: Array  # (F,)
    scale: Array  # (F,)

    @property
    def size(self) -> int:
        return len(self.scale)

    def machine(self, z: Array) -> Machine:
        change = np.zeros(len(self.free))
        change[self.free] = self.scale * z
        parts = self.start.layout.split(change)
        frame = Frame.from_vector(self.start.frame.vector() + parts.frame)
        geometry = self.start.geometry + parts.geometry
        return Machine(self.start.mechanism, geometry, frame)

    def rows(self, z: Array) -> Array:
        """Predicted less measured in standard deviations, then the priors' rows."""
        machine = self.machine(z)
        missed = [-(o.missed(machine) / o.sigma).ravel() for o in self.observations]
        return np.concatenate([*missed, z * self.scale / self.prior])

    def slopes(self, z: Array) -> Array:
        """Their derivative, (rows, F)."""
        machine = self.machine(z)
        each = [o.slopes(machine)[..., self.free] / o.sigma[:, None] for o in self.observations]
        flat = [slope.reshape(-1, self.size) * self.scale for slope in each]
        return np.concatenate([*flat, np.diag(self.scale / self.prior)])


def _problem(
    mechanism: Mechanism,
    observations: Sequence[Observation],
    frame: Frame | None,
    free: Mask | None,
    priors: bool,
) -> _Problem:
    devices = sorted({o.device for o in observations if o.device})
    placed = bool(devices)
    if not observations:
        raise InputError("observations: none is not allowed; one or more")
    if placed and frame is None:
        raise InputError(f"frame: none is not allowed with a {devices[0]}; where to start from")
    if len(devices) > 1:
        raise InputError(
            f"{' and '.join(devices)} at unknown places are not allowed; one of them at most"
        )
    parameters = mechanism.parameters
    chosen = np.ones(len(parameters), dtype=bool) if free is None else free
    layout = unknowns(len(parameters))
    every = np.full(layout.size, placed)
    every[layout.geometry] = chosen
    expected = np.full(layout.size, np.inf)
    expected[layout.geometry] = parameters.prior
    expected = expected[every]
    scale = np.where(np.isfinite(expected), expected, _STEP)
    prior = expected if priors else np.full(len(expected), np.inf)
    numbers = sum(len(o.joint) * len(o.sigma) for o in observations)
    if numbers + np.count_nonzero(np.isfinite(prior)) < len(scale):
        raise DataError(f"{numbers} measured numbers cannot set {len(scale)} unknowns")
    start = Machine(mechanism, parameters.nominal, frame or Frame.identity())
    for o in observations:
        for joint in o.joints():
            what = f"{o.kind}: joints"
            mechanism.require_reach(start.poses(joint), joint, what, "rad, m")
        _require_seen(o, start)
    return _Problem(start, tuple(observations), every, prior, scale)


def _require_seen(observation: Observation, start: Machine) -> None:
    """Refuse what cannot be predicted where the search starts: a point behind its camera."""
    bad = np.flatnonzero(~np.isfinite(observation.missed(start)).all(axis=1))
    if bad.size:
        raise DataError(
            f"{observation.kind}: number {bad[0] + 1} cannot be seen from where the "
            f"{observation.device or 'device'} is said to stand: behind it"
        )
