"""Examines a session for mistakes in rounds; the simplest sufficient hypothesis wins."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from delta_calibration.data import Session, repeats
from delta_calibration.doctor import clocks, hypotheses, loggers
from delta_calibration.doctor.change import (
    ROBOT_FILE,
    Change,
    as_it_is,
    in_order,
    joint_streams,
    joints_of,
)
from delta_calibration.doctor.checked import Checked
from delta_calibration.doctor.placing import joints_and_points
from delta_calibration.doctor.robot_file import edited_files, robots_that_come
from delta_calibration.doctor.stops import LEAST, stops_of
from delta_calibration.doctor.trial import (
    EXPLAINED,
    UNEXPLAINED,
    Trial,
)
from delta_calibration.doctor.turns import turn_answer
from delta_calibration.doctor.whole import answered_in_full, fitted
from delta_calibration.doctor.wiring import wiring
from delta_calibration.documents import Document
from delta_calibration.errors import ConfigError, MistakeError
from delta_calibration.robot import Robot, robot_document, robot_from
from delta_calibration.threads import one_thread

_ROUNDS = 4
_MANY = 0.05  # least share of frozen readings that is told


@one_thread()
def check(
    session: Session,
    robot: Robot,
    document: Document | None = None,
    source: str = "",
    prefer: str = "",
) -> Checked:
    """Examine a session for mistakes in units, wiring, clocks, frames and files.

    Args:
        session: as recorded.
        robot: the robot whose file is compared with the session.
        document: content of that file, so that its units are examined as well.
        source: name of that file.
        prefer: mistake to undo if the session does not distinguish it from others.
    """
    named = _named(session, robot)
    if named is not None:
        return named
    ordered = in_order(session, robot.joints.names)
    checked = _in_time(Checked((), ordered, robot, notes=_frozen(session), prefer=prefer))
    stops = checked.stops
    if stops is None:
        few = f"fewer than {LEAST} stops with joints and readings: only clocks were checked"
        return replace(checked, notes=(*checked.notes, few))
    for change, evidence in wiring(stops, robot):
        checked = checked.with_(change, evidence)
    checked, unexplained = _placed(checked, document, source)
    if unexplained:
        return _of_another(checked, unexplained, "its dimensions", session)
    checked = _turned(_within_limits(checked))
    return fitted(checked)


def require_sound(session: Session, robot: Robot) -> None:
    """Refuse a session with a mistake.

    Raises:
        MistakeError: names all mistakes that were found, with evidence and remedy.
    """
    found = check(session, robot).found
    if found:
        raise MistakeError("; ".join(mistake.sentence() for mistake in found))


def examine(session: Session, robot_file: str | Path, prefer: str = "") -> Checked:
    """As `check`, with a robot file, which may be invalid because of wrong units.

    Raises:
        ConfigError: the file does not exist or describes no robot, and no other unit of its
            numbers makes it a robot that fits the session.
    """
    path, document = robot_document(robot_file)
    try:
        return check(session, robot_from(document, str(path)), document, str(path), prefer)
    except ConfigError as error:
        refused = error
    fitting = []
    for change in edited_files(document, str(path)):
        robot = change.robot
        if robot is None or _named(session, robot) is not None:
            continue
        checked = Checked((), in_order(session, robot.joints.names), robot)
        if checked.stops is not None:
            trial = _trial(checked, None, "")
            fitting.append((trial.misfit, trial.placed.typical, change, robot))
    fitting = [one for one in fitting if one[0] <= EXPLAINED]
    if not fitting:
        raise refused
    _, left, change, robot = min(fitting, key=lambda one: one[:2])
    found = change.found(
        f"the file as written is refused ({_reason(refused, str(path))}); changed like this, "
        f"nominal robot and tracker agree within {1e3 * left:.3g} mm (median)"
    )
    checked = check(session, robot, prefer=prefer)
    return replace(checked, found=(*found, *checked.found), document=change.document)


def _reason(error: ConfigError, source: str) -> str:
    return str(error).removeprefix(f"{source}: ")


def lacks_joints(session: Session, robot: Robot) -> bool:
    """Whether a joint stream lacks a joint of the robot, so that nothing can be fitted."""
    return bool(_of_other_joints(session, robot))


def _of_other_joints(session: Session, robot: Robot) -> list[tuple[str, ...]]:
    """Joints of those joint streams that lack a joint of the robot."""
    streams = [joints_of(session, name) for name in joint_streams(session)]
    wanted = set(robot.joints.names)
    return [s.names for s in streams if s is not None and not wanted <= set(s.names)]


def _named(session: Session, robot: Robot) -> Checked | None:
    """Report a wrong robot if the session lacks joints of the robot; else None."""
    others = _of_other_joints(session, robot)
    if not others:
        return None
    evidence = (
        f"joints {', '.join(others[0])} were recorded, robot {robot.name} has "
        f"{', '.join(robot.joints.names)}"
    )
    return _of_another(Checked((), session, robot), evidence, "its joints' names", session)


def _of_another(checked: Checked, evidence: str, differs: str, recorded: Session) -> Checked:
    """Add the mistake `wrong_robot`, with the robot of the package that fits, if there is one.

    `recorded` still has the joints that this robot lacks and the right one may have.
    """
    fitting = next(
        (
            robot
            for robot in robots_that_come()
            for session in (checked.session, recorded)
            if _names_fit(session, robot) and _fits(session, robot)
        ),
        None,
    )
    mend = f"give the machine's own file with --robot, or set {differs} to the machine's values"
    if fitting is not None:
        mend, evidence = f"`--robot {fitting.name}`", f"{evidence}; robot {fitting.name} fits"
    change = Change("wrong_robot", (ROBOT_FILE,), as_it_is, mend, part=checked.robot.name)
    return replace(checked, found=(*checked.found, *change.found(evidence)), resolved=False)


def _names_fit(session: Session, robot: Robot) -> bool:
    streams = [joints_of(session, name) for name in joint_streams(session)]
    return all(s is not None and set(s.names) == set(robot.joints.names) for s in streams)


def _fits(session: Session, robot: Robot) -> bool:
    session = in_order(session, robot.joints.names)
    stops = stops_of(session)
    return stops is not None and Trial(session, robot, stops).misfit <= EXPLAINED


def _frozen(session: Session) -> tuple[str, ...]:
    """A note if many of the tracker's readings repeat the one before them."""
    if session.tracker is None:
        return ()
    again = repeats(session.tracker.position)
    if not again.any() or again.mean() < _MANY:
        return ()
    said = f"{again.sum()} of {len(again)} tracker readings repeat a frozen value and are left out"
    return (said,)


def _in_time(checked: Checked) -> Checked:
    """Undo exchanged streams, values held by a logger, and clock errors."""
    change = loggers.exchanged(checked.session)
    if change is not None:
        checked = checked.with_(
            change, "at rest the commands are noisy like an encoder, and the states have no noise"
        )
    session, found = loggers.held(checked.session)
    checked = replace(checked, session=session, found=(*checked.found, *found))
    session, found = clocks.clocks(checked.session)
    return replace(checked, session=session, found=(*checked.found, *found))


def _placed(checked: Checked, document: Document | None, source: str) -> tuple[Checked, str]:
    """Undo mistakes of units, wiring and frames in rounds, by the nominal robot in its best frame.

    If the rounds do not explain the session, it is returned unchanged, with a text that describes
    the unexplained distance; otherwise the text is empty.
    """
    now = checked
    trial = _trial(now, document, source)
    for _ in range(_ROUNDS):
        if trial.misfit <= EXPLAINED:
            return now, ""
        answer = trial.answer()
        if answer is None:
            break
        now = answered_in_full(now, answer)
        trial = _trial(now, document if now.robot is checked.robot else None, source)
    if trial.misfit <= EXPLAINED:
        return now, ""
    first = _trial(checked, None, source)
    return checked, _unexplained(first) if first.misfit > UNEXPLAINED else ""


def _trial(checked: Checked, document: Document | None, source: str) -> Trial:
    assert checked.stops is not None
    session = in_order(checked.session, checked.robot.joints.names)
    return Trial(session, checked.robot, checked.stops, document, source)


def _unexplained(trial: Trial) -> str:
    """The distance between nominal robot and tracker, in words."""
    left = (
        f"{1e3 * trial.placed.typical:.3g} mm (median) remain between the nominal robot and "
        "the tracker"
    )
    if not trial.placed.found:
        left = "the nominal robot cannot reach most of the poses"
    known = f" while tolerances explain {1e3 * trial.tolerated:.2g} mm" * trial.placed.found
    return f"{left}{known}, and no other mistake explains it"


def _within_limits(checked: Checked) -> Checked:
    """Undo whole turns of joints beyond their limits, which forward kinematics cannot show."""
    limits, stops = checked.robot.joints, checked.stops
    if limits.unit != "rad" or checked.robot.model().pulls or stops is None:
        return checked
    middle = np.median(joints_and_points(stops)[0], axis=0)
    for j, name in enumerate(limits.names):
        low, high = limits.lower[j], limits.upper[j]
        turns = round(float((middle[j] - (low + high) / 2) / (2 * np.pi)))
        if turns and not low <= middle[j] <= high:
            change = hypotheses.offset_joint(
                checked.robot, joint_streams(stops), j, 2 * np.pi * turns
            )
            evidence = (
                f"{name} is about {np.degrees(middle[j]):.0f} degrees, beyond its limits, and "
                f"within them with {abs(turns)} turn{'s' * (abs(turns) > 1)} less"
            )
            checked = checked.with_(change, evidence)
    return checked


def _turned(checked: Checked) -> Checked:
    """Undo a wrong order or sense of the tracker's rotations."""
    stops = checked.stops
    answer = None if stops is None else turn_answer(stops, checked.robot)
    return checked if answer is None else checked.answered(answer)
