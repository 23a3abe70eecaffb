"""`delta-cal robot`: write a robot file by questions, check it, draw it."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import click
import numpy as np

from delta_calibration.cli.options import require_folder, robots, write_or_print, write_text
from delta_calibration.cli.verb import OUTPUT, OUTPUTS, VerbGroup, forced
from delta_calibration.drafting import (
    OFFERED,
    Entry,
    commented,
    draft_from_urdf,
    entries,
    model_for,
    parts_of,
    reference,
    review,
    value_at,
    with_value,
)
from delta_calibration.errors import CalibrationError, InputError
from delta_calibration.mechanisms import MECHANISMS
from delta_calibration.plans import make_plan
from delta_calibration.plans.box import largest_box, written
from delta_calibration.robot import Robot, load_robot, robot_document, robot_from

ROBOT = click.argument("robot_file", metavar="FILE|NAME", shell_complete=robots)
OUT = click.option("--out", type=OUTPUT, required=True, help="File to write.")
PER_JOINT = {  # lists that have a value for each joint
    ("joints", key)
    for key in ("lower_deg", "upper_deg", "lower_mm", "upper_mm", "sign", "zero_deg", "zero_mm")
}
_NAMES = ("joints", "names")
_WORKSPACE = ("workspace", "centre_mm")
_TRIES = 5  # refused answers to a question, after which nobody seems to read the errors
_Answer = TypeVar("_Answer")
_RATIO = {"mm": 100.0, "degrees": 40.0}  # from which a value may be in metres, or radians
_GROWN = 1.25  # factor by which a drawing enlarges a dimension


class UnansweredError(InputError):
    """A question that was not answered."""


@click.group("robot", cls=VerbGroup)
def command() -> None:
    """Write, check and draw the file that describes a robot."""


@command.command(
    "check", short_help="check a robot file for wrong units and summarise the machine"
)
@ROBOT
def check(robot_file: str) -> int:
    """Check a robot file.

    Shows the region where the machine works, how well conditioned it is there, the position error
    that the tolerances lead to, and every entry that looks as if its unit were wrong. The exit
    code is 1 if an entry is in doubt.
    """
    robot, seen = load_robot(robot_file), review(load_robot(robot_file), _document(robot_file))
    click.echo(f"{robot.name}: {robot.mechanism}, {len(robot.joints.names)} joints")
    if robot.joints.passed_through:
        click.echo(f"  passed through: {', '.join(robot.joints.passed_through)}")
    for what, value in seen.figures:
        click.echo(f"  {what}: {value}")
    for doubt in seen.doubts:
        click.echo(f"in doubt: {doubt}")
    if not seen.doubts:
        click.echo("nothing in doubt")
    return int(bool(seen.doubts))


@command.command("draw", short_help="draw frames, zeros and directions of the joints")
@ROBOT
@OUT
@click.option(
    "--dimensions",
    type=OUTPUTS,
    default=None,
    help="Folder for a drawing of each dimension: what changes if it grows by a quarter.",
)
def draw(robot_file: str, out: Path, dimensions: Path | None) -> None:
    """Draw a robot in three views, in the middle of its workspace.

    An arrow with a joint's name shows the direction in which its reading increases. A dashed line
    shows where the link of a turning joint is at zero. The ending of the file selects SVG, PNG or
    PDF.
    """
    from delta_calibration.report.sketch import write_sketch

    robot = load_robot(robot_file)
    require_folder(out)
    write_sketch(robot, out)
    click.echo(f"written: {out}")
    if dimensions is not None:
        _make(dimensions)
        for entry, path in _pictures(robot, robot_document(robot_file)[1], dimensions):
            click.echo(f"written: {path} ({entry.about or entry.name})")


@command.command("new", short_help="write a robot file by answering questions")
@OUT
@click.option(
    "--mechanism", type=click.Choice(list(MECHANISMS)), default=None, help="Kind of robot."
)
@click.option("--name", default=None, help="Name of the robot: lower-case letters, digits and _.")
@click.option(
    "--like",
    "model",
    metavar="FILE|NAME",
    shell_complete=robots,
    default=None,
    help="Robot whose values are proposed; by default a robot of the package with the same "
    "mechanism.",
)
@click.option(
    "--pictures",
    type=OUTPUTS,
    default=None,
    help="Folder for a picture of each dimension; each question names its picture.",
)
@click.option("--yes", is_flag=True, help="Accept every proposed value without asking.")
def new(
    out: Path,
    mechanism: str | None,
    name: str | None,
    model: str | None,
    pictures: Path | None,
    yes: bool,
) -> int:
    """Write a robot file by answering a question for every entry.

    Each question explains the entry and proposes a value; Enter accepts it. Separate the items of
    a list by commas. Answers are checked at once. In the file, a comment explains every entry.
    """
    require_folder(out)
    if out.exists() and not forced():
        raise InputError(f"{out}: already exists; name another file, or replace it with --force")
    data = _begun(mechanism, model, ask=not yes)
    default = str(data["name"]) if yes else "my_robot"
    named = name or (default if yes else _prompted("name", str, default))
    data = {**data, "name": named}
    robot_from(data, str(model or data["mechanism"]))  # a name that no robot may have ends it here
    shown = _shown(data, model or str(data["mechanism"]), pictures)
    if not yes:
        data = _answered(data, shown, out)
    write_text(out, commented(data))
    click.echo(f"written: {out}")
    robot = load_robot(out)
    seen = review(robot, data)
    for doubt in seen.doubts:
        click.echo(f"in doubt: {doubt}")
    click.echo(f"next: delta-cal robot draw {out} --out {out.with_suffix('.svg')}")
    return int(bool(seen.doubts))


@command.command("from-urdf", short_help="write a serial arm's robot file from its URDF")
@click.argument("urdf", type=click.Path(path_type=Path))
@OUT
@click.option(
    "--tip", default=None, help="Link of the tool.  [default: the end of the only chain]"
)
@click.option("--base", default=None, help="Link to start from.  [default: the root of the tree]")
@click.option("--name", default=None, help="Name of the robot.  [default: the name in the URDF]")
def from_urdf(urdf: Path, out: Path, tip: str | None, base: str | None, name: str | None) -> None:
    """Write the robot file of a serial arm of turning joints from its URDF.

    Lengths, axes, joint names and limits come from the URDF, and so do masses if their centres are
    in the middle of the links: a robot file spreads a mass evenly from joint to joint. Otherwise
    masses are left out, with a note, and a diagnosis fits the first moments of the links
    (gravity_sag). Tolerances, tracker and correction limits are proposals: review them. Before the
    file is written, it is checked that URDF and robot file put the tool at the same position.
    """
    require_folder(out)
    if out.exists() and not forced():
        raise InputError(f"{out}: already exists; name another file, or replace it with --force")
    draft = draft_from_urdf(urdf, base=base, tip=tip, name=name)
    robot_from(draft.document, str(urdf))
    write_text(out, commented(draft.document, draft.notes))
    click.echo(f"written: {out}; tolerances, tracker and limits are proposals: review them")
    for note in draft.notes:
        click.echo(f"note: {note}")


@command.command("reference", short_help="write a reference page of all entries")
@click.option(
    "--out",
    type=OUTPUT,
    default=None,
    help="File to write; printed if not given.",
)
def reference_page(out: Path | None) -> None:
    """Write a reference page of all entries of robot files (Markdown)."""
    write_or_print(out, reference())


def _document(robot_file: str) -> dict[str, Any]:
    return robot_document(robot_file)[1]


def _begun(mechanism: str | None, model: str | None, *, ask: bool) -> dict[str, Any]:
    """Robot file whose values are proposed, as a document."""
    if model is not None:
        return _document(model)
    if mechanism is None:
        if not ask:
            raise click.UsageError("give --mechanism or --like")
        for kind in MECHANISMS.values():
            summary = (inspect.getdoc(kind) or "").partition("\n")[0]
            click.echo(f"{kind.name}: {summary}")
        mechanism = _prompted(f"mechanism ({', '.join(MECHANISMS)})", _mechanism)
    return model_for(mechanism)


def _mechanism(said: str) -> str:
    """Return the name of a mechanism if there is one of that name.

    Raises:
        InputError: there is no such mechanism.
    """
    if said not in MECHANISMS:
        raise InputError(f"{said!r} is not one of {', '.join(MECHANISMS)}")
    return said


def _prompted(text: str, read: Callable[[str], _Answer], default: str = "") -> _Answer:
    """Ask until `read` accepts the answer, a few times at most.

    Raises:
        UnansweredError: all answers were refused, or the input has ended.
    """
    for _ in range(_TRIES):
        try:
            said = click.prompt(text, default=default, show_default=bool(default), type=str)
        except click.Abort as error:
            if isinstance(error.__context__, EOFError):
                said = "the input ended before all questions were answered"
                raise UnansweredError(said) from error
            raise
        try:
            return read(said)
        except InputError as error:
            click.echo(str(error), err=True)
    name = text.rpartition("\n")[2]
    raise UnansweredError(f"{name}: {_TRIES} answers were refused; the last one was {said!r}")


def _shown(data: dict[str, Any], source: str, folder: Path | None) -> dict[tuple[str, ...], Path]:
    """Draw the pictures of the dimensions, and return their files by entry."""
    if folder is None:
        return {}
    _make(folder)
    robot = robot_from(data, source)
    return {entry.path: path for entry, path in _pictures(robot, data, folder)}


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be created: {error.strerror or error}") from error


def _answered(
    data: dict[str, Any], shown: dict[tuple[str, ...], Path], out: Path
) -> dict[str, Any]:
    """Ask for every entry and return the file; if interrupted, write the answers so far."""
    try:
        for entry in entries(str(data["mechanism"])):
            parts = list(parts_of(entry))
            if entry.path == _WORKSPACE:
                data = _with_room(data)
            if parts:
                data = _asked_one_by_one(entry, parts, data)
            else:
                data = _asked(entry, data, shown.get(entry.path))
    except (click.Abort, KeyboardInterrupt, UnansweredError):
        write_text(out, commented(data))
        click.echo(
            f"\nstopped; the answers so far are in {out}. To go on: "
            f"delta-cal robot new --like {out} --out ANOTHER.yaml",
            err=True,
        )
        raise
    return data


def _with_room(data: dict[str, Any]) -> dict[str, Any]:
    """Propose the largest workspace if the identification plan fails in the file's own.

    The file stays unchanged if no such box exists, or if it does not describe a robot yet.
    """
    try:
        robot = robot_from(data, str(data["name"]))
        try:
            make_plan("identify", robot)
        except CalibrationError:
            click.echo("\nlooking for a workspace within reach ...")
            return {**data, "workspace": data.get("workspace", {}) | written(largest_box(robot))}
    except CalibrationError:
        pass
    return data


def _asked_one_by_one(
    entry: Entry, parts: Sequence[Entry], data: dict[str, Any]
) -> dict[str, Any]:
    """Ask for a list of sections, first their number, then all their entries; return the file."""
    proposed = value_at(data, entry.path)
    text = f"\n{entry.about}\nnumber of {entry.path[-1]}"
    count = _prompted(text, _count, str(len(proposed)))
    made = []
    for number in range(count):
        name = f"{entry.path[-1]}[{number}]"
        section = {name: proposed[min(number, len(proposed) - 1)]}
        for part in parts:
            own = replace(part, path=(name, part.path[-1]))
            section = _asked(own, section, None, OFFERED.get(part.path))
        made.append(section[name])
    return _for_links(with_value(data, entry.path, made), count)


def _for_links(data: dict[str, Any], count: int) -> dict[str, Any]:
    """Shorten or extend the proposed lists of values per joint to `count` joints."""
    for path in (("geometry", "home_deg"), _NAMES, *sorted(PER_JOINT)):
        values = value_at(data, path)
        if values is not None:
            more = [values[-1]] * (count - len(values))
            if path == _NAMES:
                more = [f"joint_{number + 1}" for number in range(len(values), count)]
            data = with_value(data, path, [*values[:count], *more])
    return data


def _count(said: str) -> int:
    """Convert an answer to a whole number above zero.

    Raises:
        InputError: it is no such number.
    """
    if not said.isdecimal() or int(said) == 0:
        raise InputError(f"{said!r} is not allowed; a whole number above 0")
    return int(said)


def _asked(
    entry: Entry, data: dict[str, Any], picture: Path | None, offered: str | None = None
) -> dict[str, Any]:
    """Ask for one entry and return the file; the answer `offered` leaves the entry out."""
    proposed = value_at(data, entry.path)
    left_out = (offered or OFFERED.get(entry.path)) if proposed is None else None
    begun = bool(entry.within) and value_at(data, (entry.within,)) is not None
    if proposed is None and not (entry.required or begun) and left_out is None:
        return data
    unit = f" [{entry.unit}]" if entry.unit else ""
    about = f"\n{entry.about}" if entry.about else ""
    seen = f"\n(picture: {picture})" if picture else ""
    text = f"{about}{seen}\n{entry.name}{unit}"
    doubted: list[str] = []  # answers that are accepted if they are repeated

    def read(said: str) -> dict[str, Any]:
        if said == left_out:
            return data
        value = _for_joints(entry, entry.read(said), data)
        if said not in doubted and _other_unit(entry.unit, value, proposed):
            doubted.append(said)
            raise InputError(
                f"{entry.name}: {said} is far from the proposed {_written(proposed)}: is it in "
                f"{entry.unit}? If so, enter it again"
            )
        return with_value(data, entry.path, value)

    default = "" if proposed is None else _written(proposed)
    return _prompted(text, read, left_out or default)


def _other_unit(unit: str, value: Any, proposed: Any) -> bool:
    """Whether lengths or angles differ from those proposed as much as by another unit."""
    if unit not in _RATIO or value is None or proposed is None:
        return False
    ours, theirs = (float(np.abs(np.asarray(v, dtype=float)).max()) for v in (value, proposed))
    return 0.0 < ours * _RATIO[unit] < theirs or 0.0 < theirs * _RATIO[unit] < ours


def _for_joints(entry: Entry, value: Any, data: dict[str, Any]) -> Any:
    """A list with a value for every joint; a single value stands for all of them.

    Raises:
        InputError: another number of values.
    """
    if entry.path not in PER_JOINT:
        return value
    names = data["joints"]["names"]
    if len(value) == len(names):
        return value
    if len(value) == 1:
        return list(value) * len(names)
    raise InputError(
        f"{entry.name}: {len(value)} values; give one for each of {', '.join(names)}, or one for "
        "all"
    )


def _written(value: Any) -> str:
    """Proposed value in the form in which it would be typed."""
    if isinstance(value, list) and not any(isinstance(item, list | dict) for item in value):
        return ", ".join(map(str, value))
    return str(value)


def _pictures(robot: Robot, data: dict[str, Any], folder: Path) -> Iterator[tuple[Entry, Path]]:
    """Draw the robot with each dimension a quarter larger, or a fifth smaller if that fails."""
    from delta_calibration.report.sketch import write_sketch

    for entry in entries(robot.mechanism):
        value = value_at(data, entry.path)
        if entry.path[0] != "geometry" or value is None or entry.unit not in ("mm", "degrees"):
            continue
        for factor in (_GROWN, 1 / _GROWN):
            try:
                changed = robot_from(
                    with_value(data, entry.path, _times(value, factor)), robot.source
                )
            except (CalibrationError, ValueError):
                continue
            path = folder / f"{'.'.join(entry.path[1:])}.svg"
            said = f"{entry.name}: {entry.about}; {factor:.3g} times as much in blue"
            write_sketch(changed, path, before=robot, changed=said)
            yield entry, path
            break


def _times(value: Any, factor: float) -> Any:
    return (np.asarray(value, dtype=float) * factor).tolist()
