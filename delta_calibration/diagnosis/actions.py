"""Recommended action for a finding: the remedy of its effect, or that of its dimension."""

from __future__ import annotations

from delta_calibration.diagnosis.candidates import Candidate
from delta_calibration.diagnosis.verdict import Action
from delta_calibration.effects.remedy import ADJUST, COMPENSATE, MEASURE, Remedy
from delta_calibration.wording import spoken

_ZERO = Remedy(
    ADJUST,
    "joint's zero",
    "home the joint again, or enter the identified zero",
    "move the joint to its mark and read its angle from a level or a dial gauge",
)
_REFLECTOR = Remedy(
    MEASURE,
    "reflector",
    "measure where the reflector sits on the platform",
    "turn the platform, or move the reflector, and measure ten poses again",
)
_DRAWING = Remedy(
    COMPENSATE,
    "dimensions",
    "use the identified dimensions",
    "measure the dimension with the largest deviation, with a caliper or on a measuring machine",
)
_OF_DIMENSIONS = {"joint_zero_offset": _ZERO, "smr_offset": _REFLECTOR}


def action_of(term: Candidate, after_mm: float | None) -> Action:
    """Recommended action against a cause: remedy, part, remaining error and confirming test.

    Args:
        term: the cause.
        after_mm: held-out error [mm] once this cause alone is corrected; of a single dimension,
            that of the nominal machine with this dimension corrected.
    """
    remedy = _remedy_of(term)
    part = remedy.part if term.location is None else f"{remedy.part} of {term.location}"
    return Action(remedy.do, part, after_mm, remedy.confirm, remedy.how)


def _remedy_of(term: Candidate) -> Remedy:
    if term.effect is not None:
        return term.effect.remedy
    remedy = _OF_DIMENSIONS.get(term.cause, _DRAWING)
    if remedy is _DRAWING and term.cause != "geometry":
        return Remedy(
            _DRAWING.do,
            spoken(term.cause),
            "use the identified dimension",
            "measure it with a caliper or on a measuring machine",
        )
    return remedy
