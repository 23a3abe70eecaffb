"""The verdict: what is wrong, how sure, what it gains, what cannot be told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from delta_calibration.wording import capital, listed, mm, spoken, sure

SCHEMA = 1


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


@dataclass(frozen=True)
class Estimate:
    """A parameter as found."""

    value: float
    std: float | None
    unit: str


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
    in_motion: bool = False  # the errors are of readings on paths; not part of the JSON

    def called(self) -> str:
        """Cause and place, as words."""
        where = f" at {spoken(self.location)}" if self.location else ""
        return f"{spoken(self.cause)}{where}"

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
class UnknownStructure:
    """What no cause of the catalogue explains."""

    found: bool
    where: str | None
    moves_with: str | None
    rms_mm: float | None
    tests: Mapping[str, float | None]

    def moves(self) -> str:
        """With what its size changes, as words."""
        return spoken(self.moves_with or "nothing that was recorded")


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
        for finding in plain["findings"]:
            del finding["in_motion"]
        return {"schema": SCHEMA, **plain}

    def models(self) -> tuple[tuple[str, Held], ...]:
        """What the machine is held against, by the names that all outputs use."""
        known = [("before", self.baseline), ("calibrated", self.calibrated)]
        if self.extended.model != self.calibrated.model:
            known.append(("extended", self.extended))
        return tuple(known)

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
            moves = f"it moves with {self.unknown_structure.moves()}"
            beside = f"beside {named} " if named else ""
            return f"{beside}something that no known cause explains is left; {moves}"
        return named or "the calibrated geometry explains the data, and nothing else is found"


def _plain(value: Any) -> Any:
    """Tuples as lists, numbers as Python's own, all the way down."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return value.item() if hasattr(value, "item") else value
