"""What to do about a finding: by the effect's own remedy, or by what a dimension asks for."""

from __future__ import annotations

from delta_calibration.diagnosis.candidates import Candidate
from delta_calibration.diagnosis.verdict import Action
from delta_calibration.effects.remedy import ADJUST, COMPENSATE, MEASURE, Remedy
from delta_calibration.wording import spoken

_ZERO = Remedy(
    ADJUST,
    "joint's zero",
    "home the joint anew, or enter the zero that was found",
    "drive the joint to its mark and read its angle off a level or a dial gauge",
)
_REFLECTOR = Remedy(
    MEASURE,
    "reflector",
    "measure where the reflector sits on the platform",
    "turn the platform, or put the reflector elsewhere, and measure ten poses again",
)
_DRAWING = Remedy(
    COMPENSATE,
    "dimensions",
    "use the identified dimensions",
    "measure the dimension that is farthest off, by caliper or on a measuring machine",
)
_OF_DIMENSIONS = {"joint_zero_offset": _ZERO, "smr_offset": _REFLECTOR}


def action_of(term: Candidate, after_mm: float | None) -> Action:
    """What to do about a cause, on which part, what is left then, and what would confirm it.

    Args:
        term: the cause.
        after_mm: held-out error of the calibrated machine without the cause, nothing else done.
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
            "measure it, by caliper or on a measuring machine",
        )
    return remedy
