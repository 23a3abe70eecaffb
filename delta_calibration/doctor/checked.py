"""What a session was found to be."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

from delta_calibration.data import Session
from delta_calibration.doctor.change import ALTERNATIVE, Answer, Change, Mistake, in_order
from delta_calibration.doctor.stops import stops_of
from delta_calibration.documents import Document
from delta_calibration.robot import Robot


@dataclass(frozen=True)
class Checked:
    """What a session was found to be.

    `session` and `robot` are without the mistakes, as far as they could be undone, and `document`
    is the robot's file, where that is what had to be edited; `resolved` is False where something
    is wrong that no hypothesis explains.
    """

    found: tuple[Mistake, ...]
    session: Session
    robot: Robot
    resolved: bool = True
    notes: tuple[str, ...] = ()
    document: Document | None = None
    prefer: str = ""  # mistake to undo, of several that explain a session as well

    @cached_property
    def stops(self) -> Session | None:
        """Where the machine stood, its joints in the robot's order; None where that is too few."""
        return stops_of(in_order(self.session, self.robot.joints.names))

    def with_(self, change: Change, evidence: str) -> Checked:
        """With a mistake more, undone."""
        return replace(
            self,
            found=(*self.found, *change.found(evidence)),
            session=change.undo(self.session),
            robot=change.robot or self.robot,
            document=change.document or self.document,
        )

    def answered(self, answer: Answer) -> Checked:
        """With mistakes that explain it, undone, and named others that explain it as well."""
        checked, answer = self, answer.by(self.prefer)
        for change in answer.changes:
            checked = checked.with_(change, answer.evidence)
        same = answer.changes[0]
        for other in answer.others:
            doubt = f"{ALTERNATIVE} {same.mistake} in {same.streams[0]}"
            found = other.found(f"{doubt}; one of the two is true: {answer.evidence}")
            checked = replace(checked, found=(*checked.found, *found))
        return checked

    def as_dict(self) -> dict[str, object]:
        """As `check.json` has it."""
        return {"schema": 1, "found": [dict(vars(mistake)) for mistake in self.found]}
