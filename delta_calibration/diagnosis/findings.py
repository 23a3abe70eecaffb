"""Findings of a verdict: cause, location, values with errors, confidence and held-out gain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.diagnosis.actions import action_of
from delta_calibration.diagnosis.candidates import (
    Candidate,
    bounds_of,
    columns_of,
    products_of,
)
from delta_calibration.diagnosis.columns import Columns, Plain
from delta_calibration.diagnosis.constants import (
    ALPHA,
    BEYOND,
    ELSEWHERE,
    FORETOLD,
    LACKING,
    LEAST_SURE,
    MOVING,
    MUCH_OF,
    NAMED,
    WORTH,
)
from delta_calibration.diagnosis.cross_validation import (
    Gain,
    HeldOut,
    foretold,
    gain,
    held_out,
    learnable,
    scattered,
    sectors,
    sectors_of_motion,
    stretches,
)
from delta_calibration.diagnosis.experiments import further_experiment
from delta_calibration.diagnosis.fitted import Fitted, beside
from delta_calibration.diagnosis.geometry import (
    Outlier,
    Scatter,
    as_known,
    at_scatter,
    displaced,
    offset_rows,
    same_as_the_offset,
    with_whole,
    without,
    without_geometry,
)
from delta_calibration.diagnosis.joint_fit import as_score
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.model_selection import decrease_of, least_of
from delta_calibration.diagnosis.open_shapes import open_shape
from delta_calibration.diagnosis.rivals import Rivalry, equivalents, named, standing
from delta_calibration.diagnosis.scores import PRECISION, Score, log_p_of, precision_of
from delta_calibration.diagnosis.search import SearchResult
from delta_calibration.diagnosis.set_aside import set_aside
from delta_calibration.diagnosis.verdict import Estimate, Finding, Held
from delta_calibration.effects.base import SENSOR
from delta_calibration.lazy import cached_property
from delta_calibration.parameters import Parameter
from delta_calibration.theta import entries

Array = NDArray[np.float64]

MM = 1e3


class HeldOutModels:
    """Held-out errors of several models; each model is predicted only once.

    Values of one effect share their size. If the other parts do not determine a value (the gap of
    a joint whose flank changes in one sector only), this size is the deviation of its prior.
    """

    def __init__(self, model: Fitted) -> None:
        """Prepare the parts and masks for models about one fit."""
        self.evidence = evidence = model.evidence
        self.whole = model.everything().evidence
        self.sectors, self.stretches = sectors(evidence), stretches(evidence)
        self.scattered = scattered(evidence)
        self.poses = (np.arange(len(evidence)) < evidence.poses) & evidence.believed
        self.aside = np.zeros_like(self.poses)
        self.aside[set_aside(evidence, self.whole)] = True
        self.frame = held_out(without_geometry(evidence), self.sectors)
        self._alike = {m: precision_of(m, model.scaled(m)) for m in model.terms}
        self._priors: dict[tuple[int, Candidate], Array] = {}
        self._known: dict[tuple[int, tuple[Candidate, ...]], HeldOut] = {}

    def terms(self, terms: tuple[Candidate, ...], part: NDArray[np.int64]) -> HeldOut:
        """Held-out errors of the geometry with these terms."""
        key = id(part), terms
        if key not in self._known:
            prior = [self._prior(term, part) for term in terms]
            evidence, whole = (beside(e, terms, prior) for e in (self.evidence, self.whole))
            self._known[key] = held_out(evidence, part, whole)
        return self._known[key]

    def _prior(self, term: Candidate, part: NDArray[np.int64]) -> Array:
        """Precision of each value of a term where parts are predicted by the others, (k,)."""
        key = id(part), term
        if key not in self._priors:
            prior, alike = np.full(len(term.rows), PRECISION), self._alike.get(term, PRECISION)
            if alike > PRECISION:
                columns = products_of(term, self.evidence)
                prior[~learnable(self.evidence, columns, part)] = alike
            self._priors[key] = prior
        return self._priors[key]

    def placed(self, machine: Fitted) -> HeldOut:
        """Held-out errors of a known machine, whose placement is fitted without each sector."""
        return held_out(as_known(machine), self.sectors, as_known(machine.everything()))

    def told(self, name: str, held: HeldOut) -> Held:
        """Held-out error of a model for the verdict, also with the poses that were set aside."""
        whole = MM * held.rms(self.poses | self.aside) if self.aside.any() else None
        return Held(name, self.mm(held), whole)

    def gain(
        self, before: HeldOut, after: HeldOut, columns: Columns, rng: np.random.Generator
    ) -> Gain:
        """Held-out gain of one model over another on the samples where the columns show."""
        rows, noise = self._where(columns), self.evidence.variance
        place = np.round(self.evidence.chain.mechanism.position(self.evidence.pose) / 0.02)
        _, number = np.unique(place, axis=0, return_inverse=True)
        told = gain(before, after, noise, rows, number.reshape(-1), rng)
        return replace(told, in_motion=rows is not self.poses)

    def of_term(
        self, model: Fitted, term: Candidate, columns: Columns, rng: np.random.Generator
    ) -> Gain | None:
        """Held-out gain of a term beside the others; None if held-out data do not confirm it.

        A cause has to predict sectors of the workspace that it was not fitted in, and stretches of
        time if the others hold enough information on it; and it must reduce the error in metres.
        For a strong signal that leaves only noise, the error need only not grow significantly: if
        it shows in few samples, chance decides which they are. It is also enough that the parts
        agree on its values (`Foretold.of_parts`), if they show it clearly. A map only
        interpolates: it has to reduce the error enough where it interpolates and must not raise it
        in unseen sectors. Of a dimension the others may tell too little, as they also determine
        all other dimensions: then the error in metres alone has to fall significantly.
        """
        rest = tuple(m for m in model.terms if m is not term)
        evidence, bounds = beside(self.evidence, rest), bounds_of(term)
        part = self.scattered if term.unexplained else self.parts_for(evidence, columns)
        parts = [part]
        if not term.unexplained and learnable(evidence, columns, self.stretches).all():
            parts.append(self.stretches)
        if term.unexplained and not self.foretells(rest, model.terms, self._where(columns)):
            return None
        alike = self._alike.get(term, PRECISION)
        value = model.scaled(term)
        signal = float(value @ evidence.information_of(columns) @ value)
        plain = signal >= NAMED and model.misfit <= LACKING
        each = [foretold(evidence, columns, bounds, one, alike) for one in parts]
        by_values = plain and model.noise_apart and term.effect is not None
        foreseen = min(
            max(f.share, f.of_parts) if by_values and f.gain >= NAMED else f.share for f in each
        )
        if foreseen < FORETOLD and term.effect is not None:
            return None
        before, after = self.terms(rest, part), self.terms(model.terms, part)
        held = self.gain(before, after, columns, rng)
        if foreseen < FORETOLD and not held.low > 0.0:
            return None
        if term.unexplained:
            return held if held.low >= WORTH else None
        return held if held.share > 0.0 or (plain and held.high > 0.0) else None

    def parts_for(self, evidence: LinearizedModel, columns: Columns) -> NDArray[np.int64]:
        """Sectors of the poses, or of the motions if one pose sector holds nearly all of these."""
        if self._where(columns) is self.poses or learnable(evidence, columns, self.sectors).all():
            return self.sectors
        other = self._of_motion
        return other if learnable(evidence, columns, other).all() else self.sectors

    @cached_property
    def _of_motion(self) -> NDArray[np.int64]:
        """Sectors of the motions, computed only if there are any."""
        return sectors_of_motion(self.evidence)

    def foretells(
        self,
        fewer: tuple[Candidate, ...],
        terms: tuple[Candidate, ...],
        rows: NDArray[np.bool_] | None = None,
    ) -> bool:
        """Whether the larger of two models predicts held-out sectors no worse than the smaller.

        Args:
            fewer: terms of the smaller one.
            terms: terms of the larger one.
            rows: mask of the samples to compare, (n,); the poses if not given.
        """
        rows = self.poses if rows is None else rows
        without, with_ = (self.terms(of, self.sectors).rms(rows) for of in (fewer, terms))
        return with_ <= without

    def _where(self, columns: Columns) -> NDArray[np.bool_]:
        """Mask of the poses, or of the readings in motion if the columns show only there.

        What acts on a path like its own rest error also shows at rest (a drift between two stops):
        this part does not count.
        """
        evidence, size = self.evidence, columns.squares(self.evidence.coordinates)
        moving = evidence.believed & ~self.poses
        taken = evidence.rest.taken(columns) / max(1, int(moving.sum()))
        if moving.any() and size[self.poses].mean() < MOVING**2 * (size[moving].mean() - taken):
            return moving
        return self.poses

    def mm(self, held: HeldOut) -> float:
        """Root mean square over the poses [mm]."""
        return MM * held.rms(self.poses)


def of_term(
    found: SearchResult, term: Candidate, held: HeldOutModels, rng: np.random.Generator
) -> Finding | None:
    """Finding of a term; None if held-out data or rival causes refute it.

    Also None if it is not significant: a cause that replaced another, or stood beside one that was
    removed, may have been significant then but not now.
    """
    model = found.model
    if not model.scaled(term).any():  # at a bound, where it does nothing
        return None
    rest = tuple(m for m in model.terms if m is not term)
    evidence = beside(model.evidence, rest)
    columns = products_of(term, evidence)
    sector = held.of_term(model, term, columns, rng)
    if sector is None:
        return None
    tried = found.tried
    stand = standing(model, term, tried)
    log_p = _log_p(found, term, stand.signal, tried)
    if not term.unexplained and (stand.confidence < LEAST_SURE or log_p > np.log(ALPHA)):
        return None
    items = items_of(model, term)
    spread, of_shape = spread_of(evidence, model, term)
    finding = _finding(
        term,
        items,
        model.values(term),
        spread,
        stand,
        log_p,
        sector,
        separated_by(evidence, term, stand.equivalents),
    )
    action = action_of(term, error_left(held, term, finding.in_motion))
    return replace(finding, shape=shape_of(term, of_shape), action=action)


def error_left(held: HeldOutModels, term: Candidate, in_motion: bool) -> float:
    """Held-out error at rest [mm] once a cause alone is corrected.

    A cause that shows in motion only changes nothing at rest: its correction is not used there if
    it predicts the poses worse.
    """
    unused = in_motion and not held.foretells((), (term,))
    return held.mm(held.terms(() if unused else (term,), held.sectors))


def spread_of(evidence: LinearizedModel, model: Fitted, term: Candidate) -> tuple[Array, Array]:
    """Standard deviations of a term's values in units of the priors, (k,), and of its shape.

    Those of the shape, (fields,), are in units of the standard deviation of a field that is
    uniformly distributed in its interval. They follow from the residuals, including the uncertain
    shape (GUM type A), and from uncertain conditions (type B).
    """
    columns = products_of(term, evidence)
    precision = np.full(columns.width, PRECISION)
    misfit = max(1.0, model.misfit)
    if term.effect is None:
        evidence, precision = with_whole(evidence, np.array(term.rows))
    values = evidence.beside(columns, precision)
    left = open_shape(term, evidence, model.scaled(term), misfit)
    of_shape = np.linalg.inv(values.information(left.columns) / misfit + np.diag(left.precision))
    evidence = evidence.beside(Plain(left.columns), left.precision * misfit)
    normal = evidence.information_of(columns) + np.diag(precision)
    variance = np.diag(np.linalg.inv(normal)) * misfit
    doubt = None if term.effect is None else term.effect.doubt()
    if doubt is not None:
        moved = evidence.columns(doubt)[:, list(term.rows)] @ model.scaled(term)
        off = np.linalg.solve(normal, columns.along(evidence.weigh(moved[:, None])))[:, 0]
        variance = variance + off**2
    return np.sqrt(variance), np.sqrt(np.diag(of_shape))


def shape_of(term: Candidate, spread: Array) -> dict[str, Estimate | str]:
    """Searched shape of a term: frequency, time constant, moment of a step, sensor.

    Args:
        term: the term in the shape that was found.
        spread: standard deviations of its searched fields, see `spread_of`, (fields,).
    """
    effect = term.effect
    if effect is None:
        return {}
    shape: dict[str, Estimate | str] = {}
    for (name, low, high), share in zip(effect.bounded_intervals(), spread, strict=True):
        told, unit, factor = effect.as_told(name)
        std = factor * float(share) * (high - low) / 12**0.5  # of a uniform distribution
        shape[told] = Estimate(factor * float(getattr(effect, name)), std, unit)
    shape |= effect.chosen
    sensor = effect.settings.get(SENSOR)
    return shape | ({SENSOR: sensor} if isinstance(sensor, str) and sensor else {})


def of_dimension(
    found: SearchResult,
    tau: float,
    outlier: Outlier,
    held: HeldOutModels,
    rng: np.random.Generator,
) -> Finding | None:
    """Finding of a dimension that is an outlier to the machine's scatter; None if it is not.

    Beside causes it needs the least signal of one more cause: a dimension that the poses hardly
    determine takes up what the model of a strong cause leaves.
    """
    if outlier.log_p > np.log(ALPHA) or outlier.share < MUCH_OF or outlier.log_bayes <= 0:
        return None
    model, candidate = found.model, outlier.candidate
    length = outlier.value**2 * outlier.information
    if not length > least_of(decrease_of(model), model, candidate, model.terms):
        return None
    evidence = at_scatter(beside(held.evidence, model.terms), tau)
    bare = without_geometry(held.evidence)
    columns = columns_of(candidate, evidence)
    alone = held_out(bare.beside(Plain(columns), np.full(1, PRECISION)), held.sectors)
    sector = held.gain(held.frame, alone, Plain(columns), rng)
    signal = columns @ np.array([outlier.value])
    others = [s for s in found.first.scores if s.candidate.cause != candidate.cause]
    apart = float(np.clip(outlier.log_bayes, None, 500.0))
    stand = Rivalry(
        confidence=named(length) / (1 + float(np.exp(-apart))),
        equivalents=equivalents(evidence, signal, others),
        signal=length,
    )
    items = items_of(model, candidate)
    off, spread = _off_the_drawing(evidence, candidate, max(1.0, model.misfit))
    finding = _finding(
        candidate,
        items,
        np.array([p.nominal + float(off[0]) * p.prior for p in items]),
        spread,
        stand,
        outlier.log_p,
        sector,
        separated_by(evidence, candidate, stand.equivalents),
    )
    return replace(finding, action=action_of(candidate, held.mm(alone)))


def _off_the_drawing(
    evidence: LinearizedModel, dimension: Candidate, misfit: float
) -> tuple[Array, Array]:
    """How far a dimension is off its drawing and the standard deviation of that, (1,) each.

    Both in tolerances.
    """
    columns = columns_of(dimension, evidence)
    evidence, precision = with_whole(evidence, np.array(dimension.rows))
    normal = evidence.information(columns) + np.diag(precision)
    along = columns.T @ evidence.weigh(evidence.column)
    value = np.asarray(np.linalg.solve(normal, along)[:, 0])
    return value, np.asarray(np.sqrt(np.diag(np.linalg.inv(normal)) * misfit))


def of_geometry(
    found: SearchResult, scatter: Scatter, held: HeldOutModels, rng: np.random.Generator
) -> Finding | None:
    """Finding of a geometry whose dimensions exceed their tolerances as a whole.

    None if they do not, or if they do not predict sectors that they were not fitted in.
    """
    if scatter.log_p > np.log(ALPHA) or scatter.tau < BEYOND:
        return None
    rows = entries(found.model.bare.layout.geometry)
    said = _of_nuisance(found.model, "geometry", "geometry", rows, scatter.log_p, held, rng)
    return said if said.gain > 0.0 else None


def of_reflector(
    found: SearchResult, held: HeldOutModels, rng: np.random.Generator
) -> Finding | None:
    """Finding of a reflector that is farther from its place in the robot file than its prior."""
    evidence = found.model.beside
    log_p = displaced(evidence)
    if log_p > np.log(ELSEWHERE):
        return None
    rows = offset_rows(evidence)
    said = _of_nuisance(found.model, "smr_offset", "measurement", rows, log_p, held, rng)
    alike = same_as_the_offset(evidence)
    return _with_the_tool(said, found.model, alike) if alike else said


def _with_the_tool(said: Finding, model: Fitted, alike: tuple[str, ...]) -> Finding:
    """The finding of a reflector's offset that a tool out of its tolerance would explain as well.

    The fit divides what it finds between both by their priors, of which that of the offset is
    refuted: the values are those of the offset if the tool is as drawn.
    """
    free = model.placed_freely()
    rows = offset_rows(free.beside)
    unit = np.diag(free.problem.basis)[rows]
    spread = unit * np.sqrt(np.diag(free.beside.covariance())[rows] * max(1.0, model.misfit))
    values = {
        name: replace(one, value=value, std=std)
        for (name, one), value, std in zip(
            said.parameters.items(), free.theta[rows].tolist(), spread.tolist(), strict=True
        )
    }
    apart = "measure where the reflector sits on the tool"
    return replace(said, parameters=values, equivalents=alike, separated_by=apart)


def _of_nuisance(
    model: Fitted,
    cause: str,
    kind: str,
    rows: NDArray[np.int64],
    log_p: float,
    held: HeldOutModels,
    rng: np.random.Generator,
) -> Finding:
    """Finding of parameters that every calibration fits and that exceed their priors."""
    items = [model.bare.parameters.items[row] for row in rows]
    columns = held.evidence.nuisance[:, :, rows].reshape(held.evidence.size, -1)
    bare = without(held.evidence, rows)
    before = held_out(bare, held.sectors)
    nominal, prior = (np.array([getattr(p, of) for p in items]) for of in ("nominal", "prior"))
    z = (model.theta[rows] - nominal) / prior
    information = bare.information(columns)
    length = float(z @ information @ z)
    spread = np.linalg.inv(information + np.eye(len(rows))) * max(1.0, model.misfit)
    term = Candidate(cause, kind, None, None, tuple(rows.tolist()))
    finding = _finding(
        term,
        items,
        model.theta[rows],
        np.sqrt(np.diag(spread)),
        Rivalry(named(length) * -float(np.expm1(log_p)), (), length),
        log_p,
        held.gain(before, held.terms((), held.sectors), Plain(columns), rng),
        None,
    )
    return replace(finding, action=action_of(term, held.mm(held.terms((), held.sectors))))


def separated_by(
    evidence: LinearizedModel, term: Candidate, others: tuple[Candidate, ...]
) -> str | None:
    """The experiment that separates a cause from the nearest of its class, if there is one."""
    return further_experiment(evidence, term, others[0]) or None if others else None


def _finding(
    term: Candidate,
    items: list[Parameter],
    value: Array,
    spread: Array,
    stand: Rivalry,
    log_p: float,
    held: Gain,
    experiment: str | None,
) -> Finding:
    estimates = {
        p.name: Estimate(float(v - p.nominal), float(s * p.prior), _unit(term, p))
        for p, v, s in zip(items, value, spread, strict=True)
    }
    return Finding(
        cause=term.cause,
        location=term.location,
        kind=term.kind,
        equivalents=tuple(dict.fromkeys(c.cause for c in stand.equivalents)),
        separated_by=experiment,
        parameters=estimates,
        confidence=stand.confidence,
        p_value=float(np.exp(log_p)),
        rms_before_mm=MM * held.before,
        rms_after_mm=MM * held.after,
        gain=held.share,
        gain_low=held.low,
        gain_high=held.high,
        signal=stand.signal,
        in_motion=held.in_motion,
    )


def _unit(term: Candidate, parameter: Parameter) -> str:
    """Unit of a term's parameter in a verdict."""
    return parameter.unit if term.effect is None else term.effect.told_unit(parameter)


def items_of(model: Fitted, term: Candidate) -> list[Parameter]:
    """The term's free parameters."""
    if term.effect is None:
        every = model.bare.mechanism.parameters.items
    else:
        every = term.effect.parameters.items
    return [every[row] for row in term.rows]


def _log_p(found: SearchResult, term: Candidate, signal: float, tried: tuple[Score, ...]) -> float:
    """ln p of the term's signal, corrected for the number of tests and of searched shapes."""
    tries = as_score(term, tried).tries
    log_p = log_p_of(signal, len(term.rows), found.model.noise_degrees)
    return min(0.0, log_p + float(np.log(tries * found.first.tests)))
