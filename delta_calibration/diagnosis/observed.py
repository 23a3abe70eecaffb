"""A fit of observations of any kinds, in the form that the diagnosis needs.

About a fit the numbers of all kinds form one evidence: samples of d numbers if all kinds have d
numbers, else each number is a sample. The unknowns have the layout of a tracker's chain; a
reflector's offset or a frame on which nothing depends has columns of zeros.

If the noise is not known, it is estimated from the residuals: the ratios of the stated standard
deviations are kept and their common factor is fitted. An effect in the residuals is then first
counted as noise, so that tests are conservative, and lack of fit cannot be tested.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from delta_calibration.diagnosis.candidates import Candidate
from delta_calibration.diagnosis.constants import GROSS
from delta_calibration.diagnosis.fitted import Fitted, theta_layout, without_effects
from delta_calibration.diagnosis.linear_model import (
    LinearizedModel,
    less_effects,
    linearized_about,
)
from delta_calibration.diagnosis.memo import Memo
from delta_calibration.diagnosis.shared_path_error import AT_REST, SharedPathError
from delta_calibration.diagnosis.stacking import apart, stacked, weighted
from delta_calibration.diagnosis.verdict import SessionFacts
from delta_calibration.errors import DataError, InputError
from delta_calibration.estimation import Measured, PointMeasured, Problem
from delta_calibration.estimation.mixed_measurements import problem_of
from delta_calibration.geometry import Frame
from delta_calibration.mechanisms import Mechanism

Array = NDArray[np.float64]

_STILL = 1e-4  # converged if no unknown moves by more than this share of its typical size
_ROUNDS = 60


@dataclass(frozen=True)
class Observed(Fitted):
    """A fit: geometry, a device's frame and the terms found so far."""

    problem: Problem
    theta: Array
    stated: bool  # whether the noise is known; else its factor is fitted
    further: tuple[tuple[str, tuple[Measured, ...]], ...] = ()  # what else could be measured
    terms: tuple[Candidate, ...] = ()
    factor: float = 1.0  # of the stated noise
    kept: Array = field(default_factory=lambda: np.ones(0))  # (N,) 1, or 0 for a sample set aside
    memo: Memo = field(default_factory=Memo, init=False, repr=False, compare=False)

    @classmethod
    def of(
        cls,
        mechanism: Mechanism,
        measured: Sequence[Measured],
        frame: Frame | None = None,
        stated: bool = True,
        further: Sequence[tuple[str, Sequence[Measured]]] = (),
    ) -> Observed:
        """Fit the machine's geometry, and its frame if the observations depend on one.

        Args:
            mechanism: drawing and priors.
            measured: observations, at least one.
            frame: `T_device_base` to start from.
            stated: whether the noise that the observations state is known.
            further: further possible measurements, each in words and with simulated values.

        Raises:
            InputError: no observation, no frame where one is needed, an observation in motion
                together with others, or more than one set of joints for each number.
            DataError: samples out of reach, or the fit does not converge.
        """
        if len(measured) > 1 and any(m.path is not None for m in measured):
            raise InputError("observations: one taken in motion is not allowed beside others")
        more = tuple((words, tuple(parts)) for words, parts in further)
        for m in (*measured, *(part for _, parts in more for part in parts)):
            sets = len(m.observation.joints())
            if sets != 1:
                raise InputError(
                    f"{m.observation.kind}: {sets} sets of joints a number are not allowed; one"
                )
        problem = problem_of(measured, mechanism, frame)
        start = cls(problem, problem.theta0, stated, more)
        first = start.fitted(())
        gross = _gross(first.evidence)
        return replace(first, kept=1.0 - gross).fitted(()) if gross.any() else first

    @property
    def facts(self) -> SessionFacts:
        """Extent of the observations, and how many were set aside."""
        times = np.concatenate([m.at.time for m in self.problem.measured])
        count = sum(len(m.at) for m in self.problem.measured)
        aside = int(np.sum(self.kept == 0))
        duration = float(np.ptp(times)) if all(m.timed for m in self.problem.measured) else 0.0
        return SessionFacts(count, count, duration, {"outlier": aside, "frozen": 0})

    @property
    def noise_degrees(self) -> float:
        """Degrees of freedom of the noise: infinite if known, else those of the residuals."""
        return np.inf if self.stated else self.evidence.degrees

    @property
    def noise_apart(self) -> bool:
        """Whether the noise is known independently of the fit: only if it was stated."""
        return self.stated

    @property
    def floor(self) -> float:
        """Root mean square of the noise of a sample [m]."""
        return float(np.sqrt(np.nanmean(self.evidence.variance)))

    def gathered(self) -> LinearizedModel:
        """The evidence of all kinds of measurements."""
        others = tuple((words, self._gathered(parts)) for words, parts in self.further)
        own = self._gathered(self.problem.measured)
        if self.kept.size:
            own = weighted(own, self.kept)
        return replace(own, further=others)

    def fitted(self, terms: tuple[Candidate, ...]) -> Observed:
        """Fit the model with these terms instead of its own, by Gauss-Newton from its values.

        Raises:
            DataError: the fit does not converge.
        """
        theta = without_effects(self.theta, theta_layout(self.problem.layout, terms))
        now = replace(self, terms=terms, theta=theta)
        now = replace(now, terms=now.sharpened())
        for _ in range(_ROUNDS):
            step = now._stepped()
            moved = np.abs(step.theta - now.theta) / np.diag(now.extended.basis)
            now = step
            if moved.max() < _STILL:
                return now
        raise DataError(f"the fit did not converge in {_ROUNDS} steps")

    def loss(self, samples: float) -> float:
        """Chi square, and the spread of the noise where that is estimated; outliers are fixed."""
        return float(samples * (self.misfit + 2 * np.log(self.factor)))

    def elsewhere(self) -> tuple[Observed, ...]:
        """No other starting points: no reflector's offset is fitted that could be wrong."""
        return ()

    def quieter(self, found: Fitted) -> Observed:
        """The same fit: its noise is stated or estimated from the residuals."""
        return self

    def rested(self) -> Observed:
        """The same fit: `fitted` has already converged on all measurements together."""
        return self

    @property
    def reads(self) -> bool:
        """Whether all observations are tracker readings, on which a tracker's effects can act."""
        return all(type(m.observation) is PointMeasured for m in self.problem.measured)

    def _stepped(self) -> Observed:
        """The fit after one step of all unknowns, and of the noise factor if it is not known."""
        step = replace(self, theta=self.ahead())
        step = replace(step, terms=step.refined())
        if self.stated:
            return step
        return replace(step, factor=self.factor * float(np.sqrt(step.misfit)))

    def _gathered(self, measured: tuple[Measured, ...]) -> LinearizedModel:
        """Evidence of observations about this fit."""
        every = (*self.problem.measured, *(m for _, others in self.further for m in others))
        alike = len({len(m.observation.sigma) for m in every}) == 1
        parts = (self._part(m) for m in measured)
        return stacked([part if alike else apart(part) for part in parts])

    def _part(self, measured: Measured) -> LinearizedModel:
        """Evidence of one kind of observation about this fit."""
        at, observation, problem = measured.at, measured.observation, self.extended
        about = observation.linearized(problem.chain.predictor(at), self.theta)
        bad = np.flatnonzero(~np.isfinite(about.missed).all(axis=1))
        if bad.size:
            raise DataError(
                f"{observation.kind}: sample {bad[0] + 1} cannot be predicted: joints "
                f"{', '.join(f'{v:.4f}' for v in at.joint[bad[0]])} are out of reach"
            )
        whiten = measured.whiten / self.factor
        resting = measured.path is None
        path = measured.path if measured.path is not None else np.full(len(at), AT_REST)
        spread = 1.0 if resting else measured.repeatability
        size = problem.chain.mechanism.joint_size
        rest = SharedPathError.of(path, at, whiten @ about.by_joints * spread, size)
        about = less_effects(about, problem.layout, self.theta)
        return linearized_about(problem, self.theta, at, about, whiten, rest)


def _gross(evidence: LinearizedModel) -> Array:
    """1 for outliers, residuals beyond `GROSS` times the usual size; else 0, (N,)."""
    size = np.linalg.norm(evidence.left(), axis=1)
    typical = np.sqrt(2 * gammaincinv(evidence.coordinates / 2, 0.5))  # median of chi
    usual = float(np.median(size) / typical)
    return np.asarray((size > GROSS * max(usual, 1.0)).astype(float))
