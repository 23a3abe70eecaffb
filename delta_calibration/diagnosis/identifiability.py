"""Causes that a session cannot identify: those that look like others, or would not show at all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Conditions
from delta_calibration.diagnosis.candidates import Candidate, columns_of, dimensions, subsets
from delta_calibration.diagnosis.constants import HIDDEN, NAMED
from delta_calibration.diagnosis.experiments import further_experiment, visibility
from delta_calibration.diagnosis.fitted import beside
from delta_calibration.diagnosis.geometry import offset_rows, without, without_geometry
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.verdict import (
    NOTHING_LEFT,
    CannotTell,
    Finding,
    UnknownStructure,
)
from delta_calibration.effects import Effect, Stage
from delta_calibration.effects.base import SENSOR

Array = NDArray[np.float64]


def unseen(
    evidence: LinearizedModel,
    terms: tuple[Candidate, ...],
    effects: Sequence[Effect],
    findings: Sequence[Finding],
    unknown: UnknownStructure = NOTHING_LEFT,
) -> tuple[CannotTell, ...]:
    """List indistinguishable causes of the findings, and effects this session would not show.

    Args:
        evidence: linearized model about the fit, as if no term were in it.
        terms: terms of the model beyond what every calibration fits.
        effects: the catalogue.
        findings: findings of the verdict.
        unknown: structure that no cause explains.
    """
    said = [_of_class(finding) for finding in findings if finding.equivalents]
    found = {finding.cause for finding in findings}
    alike = {(f.cause, other) for f in findings for other in f.equivalents}
    reasons: dict[tuple[str, str], list[str]] = {}
    whole = beside(evidence, terms)
    for effect in effects:
        if effect.cause in found:
            continue
        disguised = effect.disguised(evidence.at.take(_resting(evidence.at)))
        if disguised is not None:
            name, other, because, following = disguised
            said.append(CannotTell((name, other), because, following))
        blind = _blind(evidence, whole, terms, effect, unknown)
        if blind is not None:
            partners, because, following = blind
            if effect.cause in partners:  # a dimension of the same name is fitted anyway
                continue
            if alike & {(partner, effect.cause) for partner in partners}:  # said above
                continue
            names = reasons.setdefault((because, following), [])
            names += [n for n in (effect.cause, *partners) if n not in names]
    if "smr_offset" not in found:
        said += _reflector(whole)
    said += [
        CannotTell(tuple(names) if len(names) > 1 else (*names, _NOTHING), because, following)
        for (because, following), names in reasons.items()
    ]
    return tuple(said)


def with_payload(causes: Sequence[Candidate], at: Conditions) -> tuple[CannotTell, ...]:
    """Causes found that begin at the only change of payload: they may be an effect of it."""
    return tuple(
        CannotTell((one.cause, "an effect of the payload"), _TOGETHER, _CHANGE_AGAIN)
        for one in causes
        if one.effect is not None and one.effect.begins_with_payload(at)
    )


_NOTHING = "none"
_OF_NEED = {
    "direction": ("direction",),
    "payload": ("payload",),
    "temperature": ("temperature", "time"),
}
_COVERED = (
    "it may be a part of the error that was found: both change the readings of this "
    "session in the same way"
)
_TOGETHER = "the error sets in at the moment when the payload changes"
_CHANGE_AGAIN = "change the payload again, and back, and measure some poses each time"
_WARMER = 1.0  # [K] range of a temperature from which it counts as changed
_MOST = 0.8  # share of the squared deviations that imitate an effect


def _reflector(evidence: LinearizedModel) -> list[CannotTell]:
    """The reflector's offset, if the platform tilts too little to identify it."""
    rows = offset_rows(evidence)
    columns = evidence.nuisance[:, :, rows].reshape(evidence.size, -1)
    if not columns.any():  # no observation depends on a reflector
        return []
    shown = np.linalg.eigvalsh(without(evidence, rows).information(columns))
    if shown[-1] >= HIDDEN:
        return []
    because = (
        "the platform hardly tilts: an offset shifts all readings in the same way as the "
        "frame does"
    )
    following = "measure where the reflector sits on the platform"
    return [CannotTell(("smr_offset", "tracker frame"), because, following)]


def _of_class(finding: Finding) -> CannotTell:
    return CannotTell(
        (finding.cause, *finding.equivalents),
        "they change the readings of this session in the same way",
        finding.separated_by or "",
    )


def _blind(
    evidence: LinearizedModel,
    whole: LinearizedModel,
    terms: tuple[Candidate, ...],
    effect: Effect,
    unknown: UnknownStructure,
) -> tuple[tuple[str, ...], str, str] | None:
    """Partners, reason and next experiment if an effect of typical size would not show, else None.

    `whole` is the evidence with the terms added to its nuisance.
    """
    shape = next(effect.shapes(evidence.at), effect)
    lacking = shape.missing(evidence.at)
    if lacking:
        return (), lacking, shape.remedied(lacking)
    bare, left = visibility(whole, shape)
    if left >= HIDDEN:
        return None
    candidate = next(subsets(shape))
    covering = _covering(evidence, terms, shape)
    if covering is not None:
        following = further_experiment(evidence, candidate, covering)
        return (covering.cause,), _COVERED, following
    following = further_experiment(whole, candidate, None)
    constant = _constant(evidence, shape)
    if bare < NAMED:
        return (), constant or _too_small(evidence, shape, unknown), following
    because = constant or "on these poses a change of geometry has the same effect"
    return _partners(whole, candidate), because, following


def _too_small(evidence: LinearizedModel, effect: Effect, unknown: UnknownStructure) -> str:
    """Reason why an effect of typical size is not visible: noise, or remaining errors like it."""
    if unknown.found and unknown.moves_with in _moves_with(evidence, effect):
        return (
            f"the remaining error also varies with {unknown.moves()} and would hide an effect "
            "of typical size"
        )
    return "an effect of typical size is below the noise of this session"


def _moves_with(evidence: LinearizedModel, effect: Effect) -> set[str]:
    """Variables that an effect depends on, in the words of `UnknownStructure.moves_with`."""
    at = evidence.at
    resting = at.take(_resting(at))
    words = {word for need in effect.needs for word in _OF_NEED.get(need, ())}
    if effect.bound_to_session:
        words |= {"time"}
    if effect.stage is not Stage.MEASUREMENT and not effect.columns(resting).any():
        words |= {"speed", "motion"}
    return words or {"position", "joint angle", "joints"}


def _resting(at: Conditions) -> NDArray[np.bool_]:
    return np.asarray(~(at.velocity != 0).any(axis=1))


def _covering(
    evidence: LinearizedModel, terms: tuple[Candidate, ...], effect: Effect
) -> Candidate | None:
    """The cause found without which an effect of typical size would be seen; None if none."""
    for term in terms:
        others = tuple(m for m in terms if m is not term)
        if not term.unexplained and visibility(beside(evidence, others), effect)[1] >= NAMED:
            return term
    return None


def _constant(evidence: LinearizedModel, effect: Effect) -> str:
    """Reason that a condition which the effect depends on never changed; empty if all did."""
    at = evidence.at
    resting = _resting(at)
    at_rest = at.take(resting)
    cool = not (np.ptp(at.temperature, axis=0) > _WARMER).any()
    if effect.settings.get(SENSOR) and cool:
        return "the temperature hardly changed"
    if resting.all() and not effect.columns(at_rest).any():
        return "nothing was measured in motion"
    if "payload" in effect.needs and np.ptp(at.payload) == 0:
        return "one payload only"
    if "direction" in effect.needs and len(np.unique(at_rest.direction, axis=0)) == 1:
        return "every pose was approached from one side"
    return ""


def _partners(evidence: LinearizedModel, candidate: Candidate) -> tuple[str, ...]:
    """Causes whose dimensions imitate the signal of an effect of typical size.

    The smallest deviations from the drawing that fit the signal are computed; the causes that most
    of them (by their squares) belong to are returned.
    """
    bare = without_geometry(evidence)
    signal = columns_of(candidate, evidence) @ np.ones(len(candidate.rows))
    geometry = evidence.geometry
    normal = bare.information(geometry) + np.eye(geometry.shape[1])
    deviation = np.linalg.solve(normal, geometry.T @ bare.weigh(signal[:, None]))[:, 0]
    share: dict[str, float] = {}
    for one in dimensions(evidence):
        share[one.cause] = share.get(one.cause, 0.0) + float(deviation[one.rows[0]] ** 2)
    total, named, reached = sum(share.values()), [], 0.0
    for cause in sorted(share, key=lambda name: -share[name]):
        if reached >= _MOST * total:
            break
        named.append(cause)
        reached += share[cause]
    return tuple(named)
