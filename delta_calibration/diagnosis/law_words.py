"""Report of a law that was found: equation, values with standard deviations, region, rival."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from delta_calibration.diagnosis.candidates import Candidate
from delta_calibration.diagnosis.findings import spread_of
from delta_calibration.diagnosis.fitted import Fitted, beside
from delta_calibration.diagnosis.law_grammar import AXES, PLATFORM, signals_of
from delta_calibration.diagnosis.law_search import Guess, Likely
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.verdict import Estimate, FoundEquation
from delta_calibration.effects.found_law import (
    ACROSS,
    FORCE,
    TEMPERATURE,
    TORQUE,
    FoundLaw,
    Quantity,
    Target,
)
from delta_calibration.effects.law_forms import ALONE, FORMS
from delta_calibration.wording import listed

_VALUES = "abc"
_FIELDS = {"middle": "c", "scale": "k", "bearing": "beta"}
_APART = {  # measurement that separates two laws of which one depends on the quantity
    "payload": "repeat poses with further payloads",
    "time": "repeat poses after the machine has cooled down, and again when it is warm",
    TEMPERATURE: "repeat poses after the machine has cooled down, and again when it is warm",
    "direction": "approach each pose from both sides",
    "travel": "approach each pose from both sides, from nearby and from far away",
    "rate": "drive the same paths at other speeds",
    "acceleration": "drive the same paths at other speeds",
    TORQUE: "repeat poses with further payloads",
    FORCE: "repeat poses with further payloads",
}
# a shift of the platform that depends on its position is also an error of the readings there
_OF_READINGS = "the readings of the tracker are off by as much"
_ANOTHER_STATION = "measure the same places with the tracker somewhere else"


def told(likely: Sequence[Likely], model: Fitted) -> tuple[FoundEquation, ...]:
    """Entries of the verdict for probable laws: one for each law and part that it moves.

    Args:
        likely: the laws, likeliest first.
        model: the fit to which each law is added, without maps.
    """
    return tuple(entry for law in likely for entry in _entries(law, model))


def _entries(law: Likely, model: Fitted) -> Iterator[FoundEquation]:
    found = fitted_with(model, law.guess)
    terms = found.terms[len(model.terms) :]
    other = _other(law)
    separated_by = None if other is None else _separated_by(law.guess, other, model.beside)
    of_readings, elsewhere = (
        (_OF_READINGS, _ANOTHER_STATION) if _moves_platform(law.guess.parts[0]) else (None, None)
    )
    for at, part in enumerate(
        dict.fromkeys(target.part for m in terms for target in _law(m).targets)
    ):
        equations, values, names = [], {}, {}
        rival = None if other is None else _words(other, at)
        for term in terms:
            for target in _law(term).targets:
                if target.part == part:
                    equations.append(equation(_law(term), target, len(terms) > 1))
                    values.update(_estimates(found, term, target, len(terms) > 1))
                    names.update(variables(_law(term), target))
        yield FoundEquation(
            stage=_law(terms[0]).kind,
            part=part,
            variables=tuple(names),
            equation="; ".join(equations),
            values=values,
            probability=law.probability,
            rival=" or ".join(filter(None, (rival, of_readings))) or None,
            separated_by=listed(filter(None, (separated_by, elsewhere))) or None,
            region={name: _range(model.beside, at) for name, at in names.items()},
        )


def _moves_platform(law: FoundLaw) -> bool:
    """Whether a law shifts the platform by its position alone, as errors of a tracker do."""
    return law.targets[0].part == PLATFORM and law.of.name in AXES and law.by is None


def fitted_with(model: Fitted, guess: Guess) -> Fitted:
    """The fit with a law added to its terms; the law's parts come last."""
    parts = [as_candidate(part) for part in guess.with_sizes()]
    return model.fitted((*model.terms, *parts))


def as_candidate(law: FoundLaw) -> Candidate:
    """A law as a candidate explanation, with all its values free."""
    cause = f"{law.cause} of {', '.join(target.moved for target in law.targets)}"
    return Candidate(cause, law.kind, None, law, tuple(range(len(law.parameters))))


def _law(term: Candidate) -> FoundLaw:
    assert isinstance(term.effect, FoundLaw)
    return term.effect


# --- equations -------------------------------------------------------------------------------


def equation(law: FoundLaw, target: Target, apart: bool = False) -> str:
    """Equation of a law as text, such as dq_1 = a_1*sin(k*q_2) + b_1*cos(k*q_2).

    Args:
        law: in its shape.
        target: what the equation moves.
        apart: whether each target has a shape of its own.
    """
    own = f"_{target.tag}"
    u = argument(law, target, own if apart else "")
    second = f"*{_less(_named(law.by, law, target), law.by.middle)}" if law.by else ""
    terms = [
        _times(f"{_VALUES[i]}{own}", FORMS[kind].text(u)) + ("" if kind == ALONE else second)
        for i, kind in enumerate(law.kinds)
    ]
    return f"{target.moved} = {' + '.join(terms)}"


def argument(law: FoundLaw, target: Target, own: str) -> str:
    """Text of the argument (u - middle) scale, with letters for the fields that were searched."""
    searched = {name for name, _, _ in law.searched}
    if law.of.name == ACROSS:
        u = f"(x*cos(beta{own}) + y*sin(beta{own}))"
    else:
        u = _less(_named(law.of, law, target), law.of.middle)
    if "middle" in searched:
        u = f"({u} - c{own})"
    elif law.middle:
        u = _less(u, float(f"{law.middle:.4g}"))
    if "scale" in searched:
        return f"k{own}*{u}"
    return u if law.scale == 1.0 else f"{law.scale:.6g}*{u}"


def _less(name: str, middle: float) -> str:
    if not middle:
        return name
    return f"({name} {'-' if middle > 0 else '+'} {abs(middle):g})"


def _times(value: str, function: str) -> str:
    return value if function == "1" else f"{value}*{function}"


# --- variables -------------------------------------------------------------------------------


def variables(law: FoundLaw, target: Target) -> dict[str, tuple[Quantity, Target, FoundLaw]]:
    """Quantities that the law depends on, by the variable names used in its equation."""
    every = {}
    for quantity in filter(None, (law.of, law.by)):
        if quantity.name == ACROSS:
            every.update({axis: (Quantity(axis), target, law) for axis in ("x", "y")})
        else:
            every[_named(quantity, law, target)] = (quantity, target, law)
    return every


def _named(quantity: Quantity, law: FoundLaw, target: Target) -> str:
    if quantity.of_joints:
        return f"{quantity.name}_{quantity.number(target.joint, law.mechanism.joints) + 1}"
    if quantity.name == FORCE:
        return f"{FORCE}_{target.tag}"
    return f"{TEMPERATURE}_{quantity.part}" if quantity.name == TEMPERATURE else quantity.name


def _range(
    evidence: LinearizedModel, of: tuple[Quantity, Target, FoundLaw]
) -> tuple[float, float]:
    """Smallest and largest value of a quantity in the session; travel begins at a reversal."""
    quantity, target, law = of
    signals = signals_of(evidence, law.robot)
    first, second = quantity.places(signals.places, target, law.mechanism.joints)
    values = signals.rows[:, first] + (signals.rows[:, second] if quantity.of_joints else 0.0)
    values = values[evidence.believed & np.isfinite(values)]
    return float(values.min()), float(values.max())


# --- values ----------------------------------------------------------------------------------


def _estimates(found: Fitted, term: Candidate, target: Target, apart: bool) -> dict[str, Estimate]:
    """Estimates of a target's values and of the searched fields, with standard deviations."""
    law, own = _law(term), f"_{target.tag}"
    rest = tuple(m for m in found.terms if m is not term)
    spread, of_shape = spread_of(beside(found.evidence, rest), found, term)
    values, prior = found.values(term), law.parameters.prior
    first = law.targets.index(target) * len(law.kinds)
    estimates = {}
    for i, kind in enumerate(law.kinds):
        row = first + i
        std = float(spread[row] * prior[row])
        estimates[f"{_VALUES[i]}{own}"] = Estimate(
            float(values[row]), std, law.value_unit(target, kind)
        )
    for (name, low, high), share in zip(law.bounded_intervals(), of_shape, strict=True):
        std = float(share) * (high - low) / 12**0.5  # of a uniform distribution
        label = _FIELDS[name] + (own if apart else "")
        estimates[label] = Estimate(float(getattr(law, name)), std, _field_unit(law, name))
    return estimates


def _field_unit(law: FoundLaw, name: str) -> str:
    unit = law.unit_of_quantity(law.of)
    if name == "bearing":
        return "rad"
    if name == "middle":
        return unit or "1"
    return f"1/{unit}" if unit else "1"


# --- rivals ----------------------------------------------------------------------------------


def _other(law: Likely) -> Guess | None:
    """The likeliest rival law whose equation differs by more than its shape; None if none."""
    others = [*law.same, *([law.rival] if law.rival else [])]
    ours = _kind(law.guess)
    return next((g for g in others if _kind(g) != ours and not _contains(g, law.guess)), None)


def _contains(one: Guess, other: Guess) -> bool:
    """Whether a law has all functions of another one of the same quantities, and more."""
    first, second = one.parts[0], other.parts[0]
    alike = (first.stage, first.targets[0], first.of, first.by) == (
        second.stage,
        second.targets[0],
        second.of,
        second.by,
    )
    return alike and {*first.kinds} > {*second.kinds}


def _kind(guess: Guess) -> tuple[object, ...]:
    law = guess.parts[0]
    return law.stage, law.targets[0], law.of, law.function, law.by


def _words(guess: Guess, at: int) -> str:
    """Equation of the law's target number `at`, or of its last target."""
    every = [(law, target) for law in guess.parts for target in law.targets]
    law, target = every[min(at, len(every) - 1)]
    return equation(law, target, len(guess.parts) > 1)


def _separated_by(one: Guess, other: Guess, evidence: LinearizedModel) -> str:
    first, second = one.parts[0], other.parts[0]
    names = [_quantities(law) for law in (first, second)]
    differ = [q for q in (*names[0], *names[1]) if (q in names[0]) != (q in names[1])]
    ways = list(dict.fromkeys(_APART[name] for name in differ if name in _APART))
    if ways:
        return listed(ways)
    ends = []
    for name, of in variables(first, first.targets[0]).items():
        low, high = _range(evidence, of)
        unit = first.unit_of_quantity(of[0])
        ends.append(f"{name}, {low:.3g} and {high:.3g} {unit}".rstrip())
    return (
        f"measure more poses near the ends of {' and of '.join(ends)}, "
        "and beyond them if the machine can reach that far"
    )


def _quantities(law: FoundLaw) -> tuple[str, ...]:
    return tuple(q.name for q in (law.of, law.by) if q is not None)
