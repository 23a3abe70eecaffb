"""`delta-cal check`: find recording mistakes in a session, and mistakes in its robot file."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import click

from delta_calibration import __version__
from delta_calibration.cli.options import (
    SESSION,
    require_folder,
    robot_option,
    topics_option,
    write_json,
)
from delta_calibration.cli.verb import NEW_FOLDER, OUTPUT, verb
from delta_calibration.data import Session
from delta_calibration.doctor import Checked, Mistake, check, examine, lacks_joints
from delta_calibration.documents import write_document
from delta_calibration.errors import DataError, InputError, MistakeError
from delta_calibration.recording import Topics, read_session, write_session
from delta_calibration.robot import Robot, robot_document
from delta_calibration.wording import listed, spoken

FORCE_ADVICE = (
    "; --force writes the calibration anyway, unless the errors are too large for this robot"
)


@verb("check")
@SESSION
@robot_option
@click.option(
    "--json",
    "json_file",
    type=OUTPUT,
    default=None,
    help="JSON file to write with the mistakes that were found.",
)
@click.option(
    "--fix",
    type=NEW_FOLDER,
    default=None,
    metavar="OUT",
    help="Folder to write the corrected session to; a corrected robot file is written beside it.",
)
@click.option(
    "--prefer",
    metavar="MISTAKE",
    default="",
    help="Mistake to correct, such as 'joints swapped' or joints_swapped, if the session does not "
    "distinguish it from others.  [default: the first that is found]",
)
@topics_option
def command(
    session: Path,
    robot_file: str,
    json_file: Path | None,
    fix: Path | None,
    prefer: str,
    topics: tuple[str, ...],
) -> None:
    """Check SESSION for recording mistakes before anything is fitted.

    Possible mistakes are each fitted to the data: wrong units, swapped or reversed joints, joints
    that count from another zero, left-handed frames, clock errors, a tracker that was moved, a
    reflector that was changed, values held by a logger, a wrong robot file. A mistake that
    explains the session by a clear margin is reported with the evidence and the remedy. The exit
    code is 1 if a mistake is found.
    """
    for path in (json_file, fix):
        if path is not None:
            require_folder(path, folder=path is fix)
    recorded = read_session(session, Topics.from_options(topics))
    prefer = "_".join(prefer.split())
    checked = examine(recorded, robot_file, prefer)
    if prefer and not any(m.mistake == prefer for m in checked.found):
        raise InputError(
            f"--prefer {spoken(prefer)!r}: not found in the session; found: "
            f"{_named(checked.found) or 'none'}"
        )
    for note in (*recorded.notes, *checked.notes):
        click.echo(f"note: {note}")
    for mistake in checked.found:
        click.echo(_described(mistake))
    if json_file is not None:
        write_json(json_file, checked.as_dict())
        click.echo(f"written: {json_file}")
    if not checked.found:
        click.echo("no mistake found")
    if fix is not None:
        _write_mended(fix, checked, recorded)
    if checked.found:
        raise click.exceptions.Exit(DataError.exit_code)


def _named(found: Iterable[Mistake]) -> str:
    """The kinds of mistakes in words, each once."""
    return listed(dict.fromkeys(spoken(mistake.mistake) for mistake in found))


def _described(mistake: Mistake) -> str:
    where = f" ({mistake.part})" if mistake.part else ""
    size = ""
    if mistake.value is not None:
        size = f": {mistake.value:.6g} {mistake.unit if mistake.unit != '1' else ''}".rstrip()
    return (
        f"{mistake.called}{where}{size}\n  evidence: {mistake.evidence}\n  remedy: {mistake.mend}"
    )


def _write_mended(out: Path, checked: Checked, recorded: Session) -> None:
    if not checked.found:
        click.echo(f"not written: {out}: there is nothing to correct")
        return
    if not checked.resolved:
        raise DataError(f"{out}: not written: the mistake is not known well enough to correct it")
    undone = [m for m in checked.found if not m.is_alternative]
    mended = "; ".join(m.called for m in undone)
    provenance = {"mended_by": f"delta-cal check {__version__}", "mended": mended}
    write_session(out, checked.session, {**provenance, "mended_from": recorded.source})
    click.echo(f"written: {out}")
    if any(mistake.is_alternative for mistake in checked.found):
        click.echo(
            f"corrected there: {mended}. This session does not distinguish it from the others: if "
            "one of them is true, name it with --prefer"
        )
    if checked.document is not None:
        beside = out.with_name(f"{out.name}_robot.yaml")
        write_document(beside, checked.document)
        click.echo(f"written: {beside}")


def warn_of_mistakes(
    session: Session,
    robot: Robot,
    robot_file: str,
    force: bool,
    out: bool,
    can_force: bool = True,
) -> tuple[Mistake, ...]:
    """Check a session before it is fitted; print and return the mistakes that are found.

    Args:
        session: as recorded.
        robot: with which the session is checked.
        robot_file: name of its file.
        force: continue even if a mistake is found.
        out: whether a calibration is to be written.
        can_force: whether the verb has `--force`, which the message then advises.

    Raises:
        InputError: the session lacks joints of the robot, so that nothing can be fitted.
        MistakeError: a mistake was found, a calibration is to be written, and `force` is not set.
    """
    checked = checked_before(session, robot, robot_file)
    if out and not force:
        require_no_mistake(session, checked, can_force)
    return checked.found


def checked_before(session: Session, robot: Robot, robot_file: str) -> Checked:
    """Check a session before it is fitted; print a warning for each mistake that is found.

    Raises:
        InputError: the session lacks joints of the robot, so that nothing can be fitted.
    """
    path, document = robot_document(robot_file)
    checked = check(session, robot, document, str(path))
    if lacks_joints(session, robot):
        raise InputError("; ".join(f"{session.source}: {m.sentence()}" for m in checked.found))
    for mistake in checked.found:
        click.echo(f"warning: {mistake.sentence()}")
    return checked


def require_no_mistake(session: Session, checked: Checked, can_force: bool = True) -> None:
    """Refuse to write a calibration from a session with a mistake.

    Args:
        session: as recorded.
        checked: what the check found.
        can_force: whether the verb has `--force`, which the message then advises.

    Raises:
        MistakeError: a mistake was found.
    """
    if checked.found:
        raise MistakeError(
            f"{session.source}: no calibration is written from a session with a mistake "
            f"({_named(checked.found)}): `delta-cal check` "
            f"explains it{' and corrects it (--fix)' if checked.resolved else ''}"
            f"{FORCE_ADVICE if can_force else ''}"
        )
