"""Write robot files: by questions or from a URDF, with comments, and review them."""

from delta_calibration.drafting.form import (
    OFFERED,
    Entry,
    commented,
    entries,
    model_for,
    parts_of,
    reference,
    value_at,
    with_value,
)
from delta_calibration.drafting.review import Review, review
from delta_calibration.drafting.serial_urdf import Draft, draft_from_urdf, robot_from_urdf

__all__ = [
    "OFFERED",
    "Draft",
    "Entry",
    "Review",
    "commented",
    "draft_from_urdf",
    "entries",
    "model_for",
    "parts_of",
    "reference",
    "review",
    "robot_from_urdf",
    "value_at",
    "with_value",
]
