"""Result of the examination of a session."""

from __future__ import annotations

from dataclasses import dataclass, replace

from delta_calibration.data import Session
from delta_calibration.doctor.change import ALTERNATIVE, Answer, Change, Mistake, called, in_order
from delta_calibration.doctor.stops import stops_of
from delta_calibration.documents import Document
from delta_calibration.lazy import cached_property
from delta_calibration.robot import Robot


@dataclass(frozen=True)
class Checked:
    """Result of the examination of a session.

    `session` and `robot` are corrected, as far as the mistakes could be undone; `document` is the
    robot file, if that had to be edited; `resolved` is False if a mistake remains that could not
    be undone.
    """

    found: tuple[Mistake, ...]
    session: Session
    robot: Robot
    resolved: bool = True
    notes: tuple[str, ...] = ()
    document: Document | None = None
    prefer: str = ""  # mistake to undo among several that explain the session equally well

    @cached_property
    def stops(self) -> Session | None:
        """Stops of the session, with joints in the robot's order; None if there are too few."""
        return stops_of(in_order(self.session, self.robot.joints.names))

    def with_(self, change: Change, evidence: str) -> Checked:
        """Add one more mistake and undo it."""
        return replace(
            self,
            found=(*self.found, *change.found(evidence)),
            session=change.undo(self.session),
            robot=change.robot or self.robot,
            document=change.document or self.document,
        )

    def answered(self, answer: Answer) -> Checked:
        """Add and undo the mistakes of an answer, and name its alternatives."""
        checked, answer = self, answer.by(self.prefer)
        for change in answer.changes:
            checked = checked.with_(change, answer.evidence)
        same = answer.changes[0]
        for other in answer.others:
            doubt = f"{ALTERNATIVE} {called(same.mistake, same.streams[0])}"
            found = other.found(f"{doubt}; one of the two is true: {answer.evidence}")
            checked = replace(checked, found=(*checked.found, *found))
        return checked

    def as_dict(self) -> dict[str, object]:
        """The result as plain data, in the form of `check.json`."""
        return {"schema": 1, "found": [dict(vars(mistake)) for mistake in self.found]}
