"""Workflow of a case: the order of the steps, their command lines, and what follows each.

    bag:    check -> fit -> diagnose -> keep
    table:  columns -> (question) -> import -> check -> ...
    too few places for a fit -> update -> keep_update, if a machine is named
    check finds a mistake -> (question) -> mend -> check ..., or continue by --force, or stop
    on request: certificate, commands, c, urdf; log for the change log of a machine

A step is a verb of `delta-cal` run in the folder of the case; file names are relative to it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from delta_calibration.bench.cases import ASKING, BAG, DONE, FAILED, TABLE, WORKING, Case
from delta_calibration.errors import DataError, InputError, MistakeError

COLUMNS, MISTAKES = "columns", "mistakes"
MAPPING = "mapping.yaml"
_ALONE = "alone"  # option of a case: why it could not be fitted by itself
STEPS = {
    "columns": "Recognising the columns of the table",
    "import": "Converting the table to a session",
    "check": "Looking for mistakes in the session",
    "mend": "Correcting the session",
    "fit": "Fitting the machine",
    "diagnose": "Looking for causes of the remaining error",
    "keep": "Adding the session to the history",
    "update": "Fitting the machine with the results of its history",
    "keep_update": "Adding the session to the history",
    "certificate": "Writing the certificate",
    "commands": "Correcting the points",
    "c": "Writing the machine as C",
    "urdf": "Writing the machine as URDF",
    "log": "Comparing all sessions of the machine",
}
FINDING_OUT = ("check", "fit", "diagnose", "keep")
EXTRAS = {  # step of an export: files that it writes
    "certificate": ("certificate.html", "certificate.pdf", "certificate.json"),
    "commands": ("commands.csv",),
    "c": ("machine.c", "machine.h"),
    "urdf": ("machine.urdf",),
}


@dataclass(frozen=True)
class Said:
    """Exit code and output of a verb.

    Attributes:
        code: its exit code; negative if a signal ended it.
        told: its standard output.
        error: last line of its standard error.
    """

    code: int
    told: str
    error: str


def first_steps(kind: str, preset: str) -> tuple[str, ...]:
    """First steps of a new case; a table of a known format needs no question."""
    if kind == TABLE:
        return ("import", *FINDING_OUT) if preset else ("columns",)
    return FINDING_OUT if kind == BAG else ("log",)


def arguments(case: Case, step: str, store: str) -> list[str]:
    """Arguments of `delta-cal` for a step; values are joined to options, as --option=value."""
    robot, store_, machine = (
        f"--robot={case.robot}",
        f"--store={store}",
        f"--machine={case.machine}",
    )
    session = [case.session, robot, *(f"--topic={topic}" for topic in case.topics)]
    force = ["--force"] if case.forced else []
    export = [robot, "--calibration=extended.yaml"]
    table, name = case.option("table"), f"{case.name}-{case.id[-4:]}"
    guess = ["--guess", f"--mapping-out={MAPPING}", "--json=columns.json"]
    found = ["--json=verdict.json", "--out=extended.yaml", "--report=report.html"]
    known = [store_, machine]
    made = [f"--id={name}", "--verdict=verdict.json", "--calibration=extended.yaml"]
    signed = ["--about=about.yaml", "--out=certificate.html", "--out=certificate.pdf"]
    steps = {
        "columns": ["import", table, robot, *guess],
        "import": ["import", table, robot, *_form(case), f"--out=bag/{case.name}"],
        "check": ["check", *session, f"--json={check_file(case)}"],
        "mend": ["check", *session, f"--fix={_mended(case)}"],
        "fit": ["fit", *session, *force, "--out=calibration.yaml"],
        "diagnose": ["diagnose", *session, *force, *found],
        "keep": ["history", "add", *session, *known, *made],
        "update": ["fit", *session, *force, *known, "--out=calibration.yaml"],
        "keep_update": ["history", "add", *session, *known, f"--id={name}", "--update"],
        "certificate": ["certificate", *session, *signed],
        "commands": ["compensate", *export, case.option("targets"), "--out=commands.csv"],
        "c": ["export", *export, "--format=c", "--out=machine.c"],
        "urdf": ["export", *export, "--format=urdf", "--out=machine.urdf"],
        "log": ["history", "report", machine, store_, "--out=log.html"],
    }
    return steps[step]


def check_file(case: Case) -> str:
    """File with the result of the check of the current session."""
    return f"check-{case.mended}.json"


def _found(case: Case, folder: Path) -> bool:
    """Whether the check was completed; an incomplete check can end with the same exit code."""
    return (folder / check_file(case)).is_file()


def _form(case: Case) -> list[str]:
    """Options for the columns: a mapping, or a preset with the second table that it needs."""
    preset, other = case.option("preset"), case.option("other")
    if not preset:
        return [f"--mapping={MAPPING}"]
    join = [f"--join={other}", f"--join-preset={case.option('other_preset')}"] if other else []
    by = [f"--by={case.option('by')}"] if other and case.option("by") else []
    unit = [f"--unit={case.option('unit')}"] if case.option("unit") else []
    return [f"--preset={preset}", *join, *by, *unit]


def made_anew(case: Case) -> tuple[str, ...]:
    """Folders to be created anew for a step, in which its verb creates another."""
    return {"mend": (f"mended-{case.mended + 1}",), "import": ("bag",)}.get(case.step, ())


def _mended(case: Case) -> str:
    return f"mended-{case.mended + 1}/{case.name}"


def begun(case: Case) -> Case:
    """The case with its next step as the running one."""
    return replace(case, step=case.waiting[0], waiting=case.waiting[1:], said="")


def again(case: Case) -> Case:
    """The case with the step that the end of the server interrupted as its next step."""
    waiting = (case.step, *case.waiting) if case.step else case.waiting
    return replace(case, step="", waiting=waiting)


def ended(case: Case, said: Said, folder: Path) -> Case:
    """Return the case after a step, with the steps or the question that follow it.

    Args:
        case: case whose `step` has just ended.
        said: exit code and output of the step.
        folder: folder of the case.
    """
    return replace(_after(case, case.step, said, folder), step="")


def _after(case: Case, step: str, said: Said, folder: Path) -> Case:
    if step == "columns" and said.code == 0:
        return _asking(case, COLUMNS)
    if step == "check" and said.code == DataError.exit_code and _found(case, folder):
        return _asking(case, MISTAKES)
    if step == "mend":
        return _after_mending(case, said, folder)
    if step in EXTRAS:
        # an export that failed does not invalidate the verdict
        return replace(_on(case), said=said.error if said.code else last_line(said.told))
    if step == "fit" and said.code == DataError.exit_code and case.machine:
        return _to_update(case, said)
    if step == "update" and said.code > 0:
        told = f"{case.option(_ALONE)}; with the history of {case.machine}: {said.error}"
        return replace(case, state=FAILED, waiting=(), said=told)
    if step in ("keep", "keep_update") and said.code > 0:
        return replace(_on(case), said=f"not added to the history: {said.error}")
    if step == "import" and said.code > 0 and (folder / MAPPING).is_file():
        return replace(_asking(case, COLUMNS), waiting=(), said=said.error)
    if said.code:
        return replace(case, state=FAILED, waiting=(), said=said.error)
    if step == "import":
        return _on(replace(case, session=f"bag/{case.name}"))
    return _on(case)


def _to_update(case: Case, said: Said) -> Case:
    """Continue with an update, because the session alone has too few places for a fit."""
    kept = () if case.forced else ("keep_update",)
    options = {**(case.options or {}), _ALONE: said.error}
    return replace(case, waiting=("update", *kept), options=options, state=WORKING)


def last_line(text: str) -> str:
    """The last line that is not empty."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1] if lines else ""


def _on(case: Case) -> Case:
    """Continue with the next step, or finish the case."""
    waiting, said = case.waiting, case.said
    if waiting[:1] == ("keep",) and (why := _not_kept(case)):
        waiting, said = waiting[1:], why
    return replace(case, waiting=waiting, said=said, state=WORKING if waiting else DONE)


def _not_kept(case: Case) -> str:
    """Reason why a session is not added to the history; empty if it is added."""
    if not case.machine:
        return "not added to the history: no machine was named"
    return (
        "not added to the history: processing was continued in spite of a mistake in the session"
        if case.forced
        else ""
    )


def _asking(case: Case, question: str) -> Case:
    return replace(case, state=ASKING, question=question)


def _after_mending(case: Case, said: Said, folder: Path) -> Case:
    """Check the mended session again, or ask again if it could not be mended."""
    mended = _mended(case)
    if not (folder / mended).is_dir():
        return replace(_asking(case, MISTAKES), said=said.error)
    robot = f"{mended}_robot.yaml"
    return replace(
        case,
        session=mended,
        robot=robot if (folder / robot).is_file() else case.robot,
        topics=(),  # the mended session has the usual names
        mended=case.mended + 1,
        waiting=FINDING_OUT,
        state=WORKING,
    )


def answered(case: Case, answer: str) -> Case:
    """Return the case after an answer to its question.

    Args:
        case: case that asks.
        answer: `take` (columns); `mend` or `force` (mistakes); `stop` (both).

    Raises:
        MistakeError: the case does not ask anything: somebody else answered first.
        InputError: the question does not have this answer.
    """
    follows: dict[str, dict[str, tuple[str, ...]]] = {
        COLUMNS: {"take": ("import", *FINDING_OUT)},
        MISTAKES: {"mend": ("mend",), "force": FINDING_OUT[1:]},
    }
    if case.state != ASKING:
        raise MistakeError("this question has already been answered")
    if answer == "stop":
        return replace(case, state="stopped", question="", waiting=(), said="stopped by you")
    if answer not in follows[case.question]:
        raise InputError(f"answer {answer!r}: is not one of the answers to this question")
    return replace(
        case,
        state=WORKING,
        step="",
        question="",
        said="",
        waiting=follows[case.question][answer],
        forced=case.forced or answer == "force",
    )


def wanted(case: Case, step: str, options: dict[str, str]) -> Case:
    """Return the case with a further export, after those that are waiting already.

    Raises:
        MistakeError: the session itself is still being processed, or asks something.
        InputError: there is no such export.
    """
    if step not in EXTRAS:
        raise InputError(f"export {step!r}: is not known; choose from: {', '.join(EXTRAS)}")
    exporting = case.state == WORKING and {case.step, *case.waiting} <= {"keep", *EXTRAS}
    if not case.at_rest and not exporting:
        raise MistakeError("the session is being processed; try again when this has finished")
    before = case.waiting if exporting else ()
    waiting = before if step in before else (*before, step)
    options = {**(case.options or {}), **options}
    step = case.step if exporting else ""
    return replace(case, state=WORKING, step=step, waiting=waiting, said="", options=options)
