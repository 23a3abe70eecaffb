"""A fit of observations of any kinds, as the diagnosis wants it.

Each kind says what it misses and how that moves with the geometry and a device's frame; how it
moves with the joints is taken by differences, so that a new kind needs no more for a diagnosis.
About a fit the numbers of all kinds are one evidence: by samples of d numbers where all kinds have
as many, else each number by itself. The unknowns are laid out as a tracker's chain has them; a
reflector's offset or a frame that nothing depends on has columns of zeros.

Where nobody knows the noise, it is what the fit leaves: the stated sizes count among each other,
their common factor is found. An effect in what is left is then first counted as noise, so that
tests err to the careful side, and lack of fit cannot be told.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from delta_calibration.chain import Chain
from delta_calibration.diagnosis.candidates import Candidate, bounds_of
from delta_calibration.diagnosis.evidence import Evidence
from delta_calibration.diagnosis.fitted import Fitted, theta_layout, without_effects
from delta_calibration.diagnosis.pooling import apart, together, weighted
from delta_calibration.diagnosis.rest import AT_REST, Rest
from delta_calibration.diagnosis.verdict import SessionFacts
from delta_calibration.effects import Effect, Stage
from delta_calibration.errors import DataError, InputError
from delta_calibration.geometry import Frame
from delta_calibration.identification.observations import (
    Machine,
    Observation,
    PointMeasured,
)
from delta_calibration.mechanisms import Mechanism
from delta_calibration.samples import Conditions

Array = NDArray[np.float64]

_STEP = 1e-3  # [m, rad] typical size of an unknown without prior
_DIFFERENCE = 1e-6  # [rad] of a joint, or what does the same
_STILL = 1e-4  # of their typical sizes by which no unknown moves any more
_ROUNDS = 60
_GROSS = 12.0  # standard deviations from which a sample is set aside


@dataclass(frozen=True)
class Measured:
    """Observations of one kind and what held while each was taken."""

    observation: Observation
    at: Conditions  # (n) joints are the observation's
    timed: bool = True  # whether the times are a clock's, or stand for an order

    def __post_init__(self) -> None:
        """Refuse conditions of other samples, and kinds of several sets of joints a number.

        Raises:
            InputError: names the kind.
        """
        kind, sets = self.observation.kind, self.observation.joints()
        if len(sets) != 1:
            raise InputError(f"{kind}: {len(sets)} sets of joints a number are not allowed; one")
        if not np.array_equal(self.at.joint, sets[0]):
            raise InputError(f"{kind}: conditions are of other joints than the observations")


@dataclass(frozen=True)
class Observed(Fitted):
    """A fit: geometry, a device's frame and the members found so far."""

    measured: tuple[Measured, ...]
    cell: Chain  # without effects
    theta: Array
    stated: bool  # whether the noise is known; else its factor is found
    further: tuple[tuple[str, tuple[Measured, ...]], ...] = ()  # what else could be measured
    members: tuple[Candidate, ...] = ()
    factor: float = 1.0  # of the stated noise
    kept: Array = field(default_factory=lambda: np.ones(0))  # (N,) 1, 0 of samples set aside

    @classmethod
    def of(
        cls,
        mechanism: Mechanism,
        measured: Sequence[Measured],
        frame: Frame | None = None,
        stated: bool = True,
        further: Sequence[tuple[str, Sequence[Measured]]] = (),
    ) -> Observed:
        """The machine with its geometry, and its frame where one matters, fitted.

        Args:
            mechanism: drawing and priors.
            measured: observations, at least one.
            frame: `T_device_base` to start from.
            stated: whether the noise that the observations state is known.
            further: what else could be measured, in words, with made-up values.

        Raises:
            InputError: no observation, or no frame where one matters.
            DataError: samples out of reach, or no rest.
        """
        if not measured:
            raise InputError("observations: none is not allowed; one or more")
        chain = Chain(mechanism, np.zeros(3), 1.0)
        theta = chain.join(mechanism.parameters.nominal, np.zeros(3), frame or Frame.identity())
        more = tuple((words, tuple(parts)) for words, parts in further)
        start = cls(tuple(measured), chain, theta, stated, more)
        if frame is None and start.placed:
            raise InputError(
                "frame: none is not allowed with positions or poses; where to start from"
            )
        first = start.fitted(())
        gross = _gross(first.evidence)
        return replace(first, kept=1.0 - gross).fitted(()) if gross.any() else first

    @property
    def bare(self) -> Chain:
        """The chain without effects."""
        return self.cell

    @property
    def facts(self) -> SessionFacts:
        """What was measured, and how much of it was set aside."""
        times = np.concatenate([m.at.time for m in self.measured])
        count = sum(len(m.at) for m in self.measured)
        aside = int(np.sum(self.kept == 0))
        duration = float(np.ptp(times)) if all(m.timed for m in self.measured) else 0.0
        return SessionFacts(count, count, duration, {"outlier": aside, "frozen": 0})

    @property
    def noise_degrees(self) -> float:
        """Infinite where the noise is known, else as much as the geometry leaves."""
        return np.inf if self.stated else self.evidence.degrees

    @property
    def noise_apart(self) -> bool:
        """Only where it was stated."""
        return self.stated

    @property
    def floor(self) -> float:
        """Root mean square of the noise of a sample [m]."""
        return float(np.sqrt(np.nanmean(self.evidence.variance)))

    @cached_property
    def placed(self) -> bool:
        """Whether anything measured goes by a frame of its own."""
        return bool(np.any(self.evidence.nuisance[:, :, self.cell.layout.frame]))

    @cached_property
    def evidence(self) -> Evidence:
        """What is left to explain, as if the members were not in the model."""
        others = tuple((words, self._gathered(parts)) for words, parts in self.further)
        own = self._gathered(self.measured)
        if self.kept.size:
            own = weighted(own, self.kept)
        return replace(own, further=others)

    def fitted(self, members: tuple[Candidate, ...]) -> Observed:
        """The model with these members instead, by Gauss-Newton from where it stands.

        Raises:
            DataError: no rest.
        """
        theta = without_effects(self.theta, theta_layout(self.cell, members))
        now = replace(self, members=members, theta=theta)
        now = replace(now, members=now.sharpened())
        for _ in range(_ROUNDS):
            step = now._stepped()
            moved = np.abs(step.theta - now.theta) / now._sizes
            now = step
            if moved.max() < _STILL:
                return now
        raise DataError(f"the fit still moves after {_ROUNDS} steps")

    def elsewhere(self) -> tuple[Observed, ...]:
        """None: no reflector's offset is fitted that could be astray."""
        return ()

    def quieter(self, found: Fitted) -> Observed:
        """Itself: noise is stated, or what the fit leaves."""
        return self

    def rested(self) -> Observed:
        """Itself: all was measured at rest."""
        return self

    def _machine(self, at: Conditions) -> tuple[Machine, Array]:
        """As built under these conditions, and its joints behind the drives, (n, m)."""
        chain = self.cell.with_effects(self._effects)
        seen, (_, _, frame) = chain.see(at, self.theta, asked="nothing"), chain.split(self.theta)
        return Machine(chain.mechanism, seen.geometry, frame), seen.joint

    @property
    def reads(self) -> bool:
        """Whether all that was measured are a tracker's readings, on which its own effects act."""
        return all(type(m.observation) is PointMeasured for m in self.measured)

    @property
    def _effects(self) -> tuple[Effect, ...]:
        return tuple(m.effect for m in self.members if m.effect is not None)

    @property
    def _scale(self) -> tuple[Array, Array]:
        """Size of each unknown of the chain, (base,), and precision of it in that unit."""
        prior = self.cell.parameters.prior
        known = np.isfinite(prior)
        return np.where(known, prior, _STEP), known.astype(float)

    @property
    def _sizes(self) -> Array:
        """Typical size of each entry of theta, (P,)."""
        scale, _ = self._scale
        own = [effect.parameters.prior for effect in self._effects]
        return np.concatenate([np.where(scale > 0, scale, 1.0), *own])

    def _stepped(self) -> Observed:
        """One step of everything, and of the noise where it is not known."""
        layout, (scale, _) = self.column_layout, self._scale
        z = self.beside.best()
        theta = self.cell.parameters.nominal + scale * z[layout.base]
        for member, columns in zip(self.members, layout.each, strict=True):
            v, rows = z[columns], np.array(member.rows)
            if member.effect is None:
                theta[rows] += scale[rows] * v
                continue
            prior = member.effect.parameters.prior
            values = np.zeros(len(prior))
            values[rows] = prior[rows] * np.clip(v, *bounds_of(member, self.evidence))
            theta = np.concatenate([theta, values])
        step = replace(self, theta=theta)
        step = replace(step, members=step.refined())
        if self.stated:
            return step
        return replace(step, factor=self.factor * float(np.sqrt(step.misfit)))

    def _gathered(self, measured: tuple[Measured, ...]) -> Evidence:
        """Evidence of observations about this fit."""
        every = (*self.measured, *(m for _, others in self.further for m in others))
        alike = len({len(m.observation.sigma) for m in every}) == 1
        parts = (self._part(m) for m in measured)
        return together([part if alike else apart(part) for part in parts])

    def _part(self, measured: Measured) -> Evidence:
        """Evidence of one kind."""
        at = measured.at
        machine, joint = self._machine(at)
        moved = _at(measured.observation, joint)
        off, slopes = moved.missed(machine), moved.slopes(machine)
        bad = np.flatnonzero(~np.isfinite(off).all(axis=1))
        if bad.size:
            raise DataError(
                f"{moved.kind}: sample {bad[0] + 1} cannot be predicted: joints "
                f"{', '.join(f'{v:.4f}' for v in at.joint[bad[0]])} are out of reach"
            )
        seen = at
        if self.reads:
            assert isinstance(moved, PointMeasured)
            seen = replace(at, reading=moved.point - off)
            off = off - self._shift(seen)
        n, d = off.shape
        scale, precision = self._scale
        whiten = np.broadcast_to(np.diag(1 / (moved.sigma * self.factor)), (n, d, d))
        layout, own = self.cell.layout, machine.layout
        slopes = layout.columns(  # a reflector's offset is the observation's own
            slopes[..., own.geometry], turn=slopes[..., own.turn], place=slopes[..., own.place]
        )
        columns = whiten @ (slopes * scale)
        precision = np.where(columns.any(axis=(0, 1)), precision, 1.0)
        by_joints = whiten @ _by_joints(moved, machine)
        base = layout.base
        z = (self.theta[base] - self.cell.parameters.nominal) / self._sizes[base]
        evidence = Evidence(
            chain=self.cell.with_effects(self._effects),
            theta=self.theta,
            at=at,
            pose=machine.poses(joint),
            whiten=whiten,
            residual=(whiten @ off[..., None])[..., 0] + columns @ z,
            nuisance=columns,
            rest=Rest.of(np.full(n, AT_REST), at, by_joints),
            precision=precision,
            poses=n,
            by_joints=by_joints,
            by_geometry=whiten @ slopes[..., layout.geometry],
            seen=seen,
        )
        effects = evidence.chain.effect_values(self.theta)
        for effect, value in zip(self._effects, effects, strict=True):
            shift = evidence.columns(effect) @ (value / effect.parameters.prior)
            evidence = replace(evidence, residual=evidence.residual + shift.reshape(n, d))
        return evidence

    def _shift(self, seen: Conditions) -> Array:
        """What the effects on readings add, (n, 3) [m]."""
        values = self.cell.with_effects(self._effects).effect_values(self.theta)
        shift = np.zeros((len(seen), 3))
        for effect, value in zip(self._effects, values, strict=True):
            if effect.stage is Stage.MEASUREMENT:
                shift += effect.columns(seen) @ value
        return shift


def _at(observation: Observation, joint: Array) -> Observation:
    """The same measured at other joints (n, m)."""
    moved: Observation = replace(cast(Any, observation), joint=joint)
    return moved


def _by_joints(observation: Observation, machine: Machine) -> Array:
    """d(predicted)/d(joints), (n, d, m), by central differences."""
    joint = observation.joint
    h = _DIFFERENCE * machine.mechanism.joint_size
    slopes = []
    for step in h * np.eye(joint.shape[1]):
        ahead, back = (_at(observation, joint + way).missed(machine) for way in (step, -step))
        slopes.append((back - ahead) / (2 * h))
    return np.stack(slopes, axis=-1)


def _gross(evidence: Evidence) -> Array:
    """1 for samples that lie out of the common, (N,)."""
    size = np.linalg.norm(evidence.left(), axis=1)
    usual = float(np.median(size) / np.sqrt(chi2.ppf(0.5, evidence.coordinates)))
    return np.asarray((size > _GROSS * max(usual, 1.0)).astype(float))
