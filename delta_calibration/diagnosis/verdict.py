"""The verdict of a diagnosis: causes found, their confidence and gain, and what stays open."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from math import inf
from typing import Any

from delta_calibration.wording import capital, listed, measured, mm, plain, set_aside, spoken, sure

SCHEMA = 2
_ORDER, _PER_METRE = "order", "1/m"  # entry of a shape, and its unit where joints slide


@dataclass(frozen=True)
class SessionFacts:
    """Extent of the session on which the verdict is based."""

    samples: int
    poses: int
    duration_s: float
    rejected: Mapping[str, int]  # readings that took no part, by reason

    def set_aside(self) -> str:
        """Number of readings that took no part and the reasons, in words."""
        return set_aside(self.rejected)


@dataclass(frozen=True)
class Held:
    """A model of the machine and its held-out error."""

    model: str
    held_out_rms_mm: float | None
    with_set_aside_rms_mm: float | None = None  # the same with the poses that were set aside


@dataclass(frozen=True)
class Estimate:
    """Estimate of a parameter: value, standard deviation (None if unknown) and unit."""

    value: float
    std: float | None
    unit: str


@dataclass(frozen=True)
class Action:
    """Recommended action against a cause."""

    do: str  # adjust, repair, compensate or measure
    part: str
    # of the calibrated machine if only this cause is removed; None if not predicted
    held_out_rms_after_mm: float | None
    confirm: str  # the one test that would confirm the cause
    how: str = ""  # in words

    def sentence(self) -> str:
        """The action as an instruction in words, with the error that is expected to remain."""
        after = self.held_out_rms_after_mm
        expected = f"; {mm(after)} mm will remain" if after is not None else ""
        told = f": {self.how}" if self.how else ""
        return f"to do: {self.do} ({spoken(self.part)}){told}{expected}"


@dataclass(frozen=True)
class Finding:
    """A cause that was found: location, confidence, parameters and gain on held-out data."""

    cause: str
    location: str | None
    kind: str
    equivalents: tuple[str, ...]
    separated_by: str | None
    parameters: Mapping[str, Estimate]
    confidence: float
    p_value: float
    rms_before_mm: float
    rms_after_mm: float
    gain: float
    gain_low: float  # of its 95 % interval
    gain_high: float
    signal: float  # lambda
    shape: Mapping[str, Estimate | str] = field(default_factory=dict)  # searched fields by name
    action: Action | None = None
    in_motion: bool = False  # whether the errors are of readings on paths; not part of the JSON

    def as_dict(self) -> dict[str, Any]:
        """The finding as JSON; values, standard deviations and units of a shape stand apart."""
        told: dict[str, Any] = _plain(asdict(self))
        del told["in_motion"]
        shape = told.pop("shape")
        told["shape"] = {n: e if isinstance(e, str) else e["value"] for n, e in shape.items()}
        searched = {n: e for n, e in shape.items() if not isinstance(e, str)}
        told["shape_std"] = {name: each["std"] for name, each in searched.items()}
        told["shape_unit"] = {name: each["unit"] for name, each in searched.items()}
        if told["action"] is None:
            del told["action"]
        return told

    def called(self) -> str:
        """Cause and location in words."""
        where = f" at {spoken(self.location)}" if self.location else ""
        return f"{spoken(self.cause)}{where}"

    def clearest(self, most: int) -> dict[str, Estimate]:
        """The `most` parameters farthest from zero in standard deviations, in their own order.

        Without those that the session does not determine: their standard deviation is larger than
        any value of that unit. Of a finding with no other, the clearest one.
        """

        def off(name: str) -> float:
            value = self.parameters[name]
            return abs(value.value) / value.std if value.std else inf

        largest: dict[str, float] = {}
        for e in self.parameters.values():
            largest[e.unit] = max(largest.get(e.unit, 0.0), abs(e.value))
        known = [n for n, e in self.parameters.items() if not (e.std or 0.0) > largest[e.unit]]
        clear = sorted(self.parameters, key=off, reverse=True)
        chosen = [name for name in clear if name in known][:most] or clear[:1]
        return {name: e for name, e in self.parameters.items() if name in chosen}

    def shape_told(self) -> tuple[str, ...]:
        """The searched fields of the shape with standard deviations, in words."""
        return tuple(_told(name, value) for name, value in self.shape.items())

    def to_separate(self) -> str:
        """How to separate it from causes indistinguishable from it; empty if it is not known."""
        return f"; to separate them: {self.separated_by}" if self.separated_by else ""

    def found_in_full(self) -> tuple[str, ...]:
        """Lines of text: searched shape, recommended action and test that confirms the cause."""
        lines = [", ".join(self.shape_told())]
        if self.action is not None:
            lines += [self.action.sentence(), f"to confirm: {self.action.confirm}"]
        return tuple(filter(None, lines))

    def errors(self) -> str:
        """Held-out error without and with the cause, of poses or readings in motion, in words."""
        of = " in motion" if self.in_motion else ""
        return (
            f"held-out error{of} {mm(self.rms_before_mm)} mm without it, "
            f"{mm(self.rms_after_mm)} mm with it"
        )

    def label(self) -> str:
        """Cause and location, the causes indistinguishable from it, and confidence, in words."""
        others = "".join(f" or {spoken(name)}" for name in self.equivalents)
        return f"{self.called()}{others} ({sure(self.confidence)} sure)"


@dataclass(frozen=True)
class FoundEquation:
    """A law found for structure without a named cause, at one part of the machine; SI units.

    Attributes:
        stage: drive, structure or measurement.
        part: part that it moves: `joint_2`, `rod_1a`, `base`, `platform`, `tracker`, ...
        variables: names of the quantities that it depends on, as in the equation.
        equation: one equation for each number that it moves, separated by `;`.
        values: estimates for the letters in the equation.
        probability: of this law or one indistinguishable from it in this session.
        rival: equation of the next law, or what else would look the same; None if nothing.
        separated_by: measurement that would separate the two.
        region: smallest and largest value of each variable in the session, where the law is known.
    """

    stage: str
    part: str
    variables: tuple[str, ...]
    equation: str
    values: Mapping[str, Estimate]
    probability: float
    rival: str | None
    separated_by: str | None
    region: Mapping[str, tuple[float, float]]

    def seen(self) -> tuple[str, ...]:
        """The region in words, one text for each variable."""
        return tuple(
            f"{name} {low:.4g} to {high:.4g}" for name, (low, high) in self.region.items()
        )


@dataclass(frozen=True)
class UnknownStructure:
    """Structure in the residuals that no cause of the catalogue explains."""

    found: bool
    where: str | None
    moves_with: str | None
    rms_mm: float | None
    tests: Mapping[str, float | None]
    laws: tuple[FoundEquation, ...] = ()  # likeliest first; none if none is probable enough

    def moves(self) -> str:
        """Quantity with which its size varies, in words."""
        return spoken(self.moves_with or "nothing that was recorded")


NOTHING_LEFT = UnknownStructure(False, None, None, None, {})


@dataclass(frozen=True)
class CannotTell:
    """Causes that this session cannot separate or detect, and the measurement that would."""

    between: tuple[str, ...]
    because: str
    next: str  # empty if no measurement is known

    def why(self) -> str:
        """The reason and the next measurement, in words."""
        return "; ".join(filter(None, (self.because, self.next)))


@dataclass(frozen=True)
class Verdict:
    """The answer to: why does the robot not stand where its model says?"""

    session: SessionFacts
    noise_mm: float | None
    baseline: Held
    calibrated: Held
    extended: Held
    findings: tuple[Finding, ...]
    unknown_structure: UnknownStructure
    cannot_tell: tuple[CannotTell, ...]

    def as_dict(self) -> dict[str, Any]:
        """The verdict as JSON, in the form that `schemas/verdict.json` defines."""
        plain = _plain(asdict(self))
        plain["findings"] = [finding.as_dict() for finding in self.findings]
        for model in ("baseline", "calibrated", "extended"):
            if plain[model]["with_set_aside_rms_mm"] is None:
                del plain[model]["with_set_aside_rms_mm"]
        return {"schema": SCHEMA, **plain}

    def models(self) -> tuple[tuple[str, Held], ...]:
        """The models that the machine is compared with, by the names that all outputs use."""
        known = [("before", self.baseline), ("calibrated", self.calibrated)]
        if self.extended.model != self.calibrated.model:
            known.append(("extended", self.extended))
        return tuple(known)

    def with_set_aside(self) -> str:
        """Held-out errors including the poses set aside, in words; empty if there are none."""
        told = [
            f"{mm(model.with_set_aside_rms_mm)} mm {name}"
            for name, model in self.models()
            if model.with_set_aside_rms_mm is not None
        ]
        return f"held-out error including the poses set aside: {', '.join(told)}" if told else ""

    def sentence(self) -> str:
        """First sentence of a report: causes, their confidence, and errors of the models."""
        told = [
            f"{mm(model.held_out_rms_mm)} mm {name}"
            for name, model in self.models()
            if model.held_out_rms_mm is not None
        ]
        errors = f": held-out error {', '.join(told)}" if told else ""
        return f"{capital(self._what())}{errors}."

    def _what(self) -> str:
        named = listed(finding.label() for finding in self.findings)
        if self.unknown_structure.found:
            moves = f"it varies with {self.unknown_structure.moves()}"
            beside = f"beside {named} " if named else ""
            return f"{beside}an error remains that no known cause explains; {moves}"
        return named or "the calibrated geometry explains the data; nothing else was found"


def _told(name: str, value: Estimate | str) -> str:
    """A searched value in words; a unit at the end of the name is not repeated in it."""
    if isinstance(value, str):
        return f"{spoken(name)} {value}"
    if name == _ORDER and value.unit == _PER_METRE:
        size = plain(measured(value.value, value.std, "1"))
        return f"{name} {size} cycles per m (period {1e3 / value.value:.5g} mm)"
    words = spoken(name.removesuffix(f"_{value.unit.lower()}"))
    unit = "" if value.unit in ("", "1") else f" {value.unit}"
    error = "" if value.std is None else f" +- {value.std:.2g}"
    return f"{words} {value.value:.4g}{error}{unit}"


def _plain(value: Any) -> Any:
    """Convert tuples to lists and numbers to Python's own types, recursively."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return value.item() if hasattr(value, "item") else value
