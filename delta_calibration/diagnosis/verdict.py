"""The verdict: what is wrong, how sure, what it gains, what cannot be told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from math import inf
from typing import Any

from delta_calibration.wording import capital, listed, mm, spoken, sure

SCHEMA = 2


@dataclass(frozen=True)
class SessionFacts:
    """What the verdict rests on."""

    samples: int
    poses: int
    duration_s: float
    rejected: Mapping[str, int]  # readings that took no part, by reason

    def set_aside(self) -> str:
        """How many readings took no part and why, as words."""
        return listed(f"{n} {spoken(reason)}" for reason, n in self.rejected.items() if n)


@dataclass(frozen=True)
class Held:
    """A model and how well it predicts what it has not seen."""

    model: str
    held_out_rms_mm: float | None
    with_set_aside_rms_mm: float | None = None  # the same with poses that were set aside


@dataclass(frozen=True)
class Estimate:
    """A parameter as found."""

    value: float
    std: float | None
    unit: str


@dataclass(frozen=True)
class Action:
    """What to do about a cause."""

    do: str  # adjust, repair, compensate or measure
    part: str
    # of the calibrated machine without the cause and nothing else done; None where not foretold
    held_out_rms_after_mm: float | None
    confirm: str  # the one test that would confirm the cause
    how: str = ""  # in words

    def sentence(self) -> str:
        """As an order, with what is to be expected."""
        after = self.held_out_rms_after_mm
        expected = f"; {mm(after)} mm will remain" if after is not None else ""
        told = f": {self.how}" if self.how else ""
        return f"to do: {self.do} ({spoken(self.part)}){told}{expected}"


@dataclass(frozen=True)
class Finding:
    """A cause, where it sits, how sure it is, and what knowing it gains on held-out data."""

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
    shape: Mapping[str, Estimate | str] = field(default_factory=dict)  # what was searched
    action: Action | None = None
    in_motion: bool = False  # the errors are of readings on paths; not part of the JSON

    def as_dict(self) -> dict[str, Any]:
        """As the JSON of the contract: of a shape the values, errors and units beside them."""
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
        """Cause and place, as words."""
        where = f" at {spoken(self.location)}" if self.location else ""
        return f"{spoken(self.cause)}{where}"

    def clearest(self, most: int) -> dict[str, Estimate]:
        """Of the parameters those that are the most errors off their expectation, in order."""

        def off(name: str) -> float:
            value = self.parameters[name]
            return abs(value.value) / value.std if value.std else inf

        chosen = sorted(self.parameters, key=off, reverse=True)[:most]
        return {name: e for name, e in self.parameters.items() if name in chosen}

    def shape_told(self) -> tuple[str, ...]:
        """What was searched, with its errors, in words."""
        return tuple(_told(name, value) for name, value in self.shape.items())

    def found_in_full(self) -> tuple[str, ...]:
        """What was searched, what to do and what would confirm the cause, a line each."""
        lines = [", ".join(self.shape_told())]
        if self.action is not None:
            lines += [self.action.sentence(), f"to confirm: {self.action.confirm}"]
        return tuple(filter(None, lines))

    def errors(self) -> str:
        """What is left without and with the cause, of poses or of what it shows in."""
        of = " in motion" if self.in_motion else ""
        return (
            f"held-out error{of} {mm(self.rms_before_mm)} mm without it, "
            f"{mm(self.rms_after_mm)} mm with it"
        )

    def label(self) -> str:
        """Cause and place, how sure that is, and what the session cannot tell it from."""
        others = "".join(f" or {spoken(name)}" for name in self.equivalents)
        return f"{self.called()}{others} ({sure(self.confidence)} sure)"


@dataclass(frozen=True)
class FoundEquation:
    """A law of what has no name, at one part of the machine; all in SI units.

    Attributes:
        stage: drive, structure or measurement.
        part: what it moves: `joint_2`, `rod_1a`, `base`, `platform`, `tracker`, ...
        variables: what it depends on, by the glossary's names.
        equation: for each number that it moves, with `;` between them.
        values: of what the equation has letters for.
        probability: of the law, or another that makes the same of this session.
        rival: the next law, as an equation; None where there is none.
        separated_by: what would part the two.
        region: smallest and largest value of each variable in the session: it is known there.
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
        """The region, as words."""
        return tuple(
            f"{name} {low:.4g} to {high:.4g}" for name, (low, high) in self.region.items()
        )


@dataclass(frozen=True)
class UnknownStructure:
    """What no cause of the catalogue explains."""

    found: bool
    where: str | None
    moves_with: str | None
    rms_mm: float | None
    tests: Mapping[str, float | None]
    laws: tuple[FoundEquation, ...] = ()  # likeliest first; none where none is sure enough

    def moves(self) -> str:
        """With what its size changes, as words."""
        return spoken(self.moves_with or "nothing that was recorded")


NOTHING_LEFT = UnknownStructure(False, None, None, None, {})


@dataclass(frozen=True)
class CannotTell:
    """Causes that this session cannot part or see, and what would."""

    between: tuple[str, ...]
    because: str
    next: str


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
        """As the JSON of the contract; `verdict.schema.json` holds its form."""
        plain = _plain(asdict(self))
        plain["findings"] = [finding.as_dict() for finding in self.findings]
        for model in ("baseline", "calibrated", "extended"):
            if plain[model]["with_set_aside_rms_mm"] is None:
                del plain[model]["with_set_aside_rms_mm"]
        return {"schema": SCHEMA, **plain}

    def models(self) -> tuple[tuple[str, Held], ...]:
        """What the machine is held against, by the names that all outputs use."""
        known = [("before", self.baseline), ("calibrated", self.calibrated)]
        if self.extended.model != self.calibrated.model:
            known.append(("extended", self.extended))
        return tuple(known)

    def with_set_aside(self) -> str:
        """The models' errors with the poses that were set aside; empty where none was."""
        told = [
            f"{mm(model.with_set_aside_rms_mm)} mm {name}"
            for name, model in self.models()
            if model.with_set_aside_rms_mm is not None
        ]
        return f"held-out error including the poses set aside: {', '.join(told)}" if told else ""

    def sentence(self) -> str:
        """What an engineer reads first: what it is, how sure, and the errors of the models."""
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
    """A searched value, as words; the unit is in the name where it is an SI unit of time."""
    if isinstance(value, str):
        return f"{spoken(name)} {value}"
    words = spoken(name.removesuffix(f"_{value.unit.lower()}"))
    unit = "" if value.unit in ("", "1") else f" {value.unit}"
    error = "" if value.std is None else f" +- {value.std:.2g}"
    return f"{words} {value.value:.4g}{error}{unit}"


def _plain(value: Any) -> Any:
    """Tuples as lists, numbers as Python's own, all the way down."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return value.item() if hasattr(value, "item") else value
