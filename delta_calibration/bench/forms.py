"""Handlers of POST requests: dropped sessions, answers to questions, exports, orders to a cell."""

from __future__ import annotations

import shutil
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from datetime import datetime, timezone
from math import isnan
from pathlib import Path
from typing import IO, Any

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import FormData, UploadFile
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response

from delta_calibration.bench.cases import LOG, TABLE, Case, file_name
from delta_calibration.bench.flow import MAPPING, answered, first_steps, wanted
from delta_calibration.bench.pages import bench_of
from delta_calibration.bench.state import Bench
from delta_calibration.bench.upload import MOST_SMALL, copy, take_all
from delta_calibration.documents import write_document
from delta_calibration.errors import InputError
from delta_calibration.files import MOST_TEXT, written_whole
from delta_calibration.recording.presets import preset
from delta_calibration.robot import known_robots, load_robot
from delta_calibration.texts import number_of

_MOST_FILES, _MOST_FIELDS = 30, 40  # in a form
_LONGEST = 200  # most characters of a one-line field
_ROBOT = "robot.yaml"
_WAYS = ("row", "name", "nearest")
_UNITS = ("", "m", "mm", "um", "inch")
_STATED = {  # field of the form: keys in the file of --about
    "number": ("number",),
    "customer": ("customer",),
    "operator": ("operator",),
    "machine_model": ("machine", "model"),
    "machine_serial": ("machine", "serial"),
    "instrument_model": ("instrument", "model"),
    "instrument_serial": ("instrument", "serial"),
    "instrument_certificate": ("instrument", "certificate"),
}
_STATED_NUMBERS = {"tolerance_mm": ("tolerance_mm",), "ambient": ("ambient", "temperature_c")}


async def drop(request: Request) -> Response:
    """Store a dropped session or table, and start to process it."""
    bench = bench_of(request)
    async with _form(request, bench) as form:
        id_ = bench.cases.new_id()
        folder = bench.cases.folder(id_)
        try:
            case = await run_in_threadpool(_dropped, bench, form, id_, folder)
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
    bench.cases.add(case)
    bench.runner.take(id_)
    return _to(f"/sessions/{id_}")


async def answer(request: Request) -> Response:
    """Continue a case after its question was answered."""
    bench, id_ = bench_of(request), request.path_params["id"]
    async with _form(request, bench) as form:
        chosen, mapping = _line(form, "answer"), str(form.get("mapping", ""))
        form_ = _line(form, "preset")
    folder = bench.cases.folder(id_)

    def change(case: Case) -> Case:
        after = answered(case, chosen)
        if chosen != "take":
            return after
        if form_:
            preset(form_)
        else:
            _write_mapping(folder / MAPPING, mapping)
        return replace(after, options={**(after.options or {}), "preset": form_})

    await run_in_threadpool(bench.cases.change, id_, change)
    bench.runner.take(id_)
    return _to(f"/sessions/{id_}")


async def stop(request: Request) -> Response:
    """Stop the work on a session."""
    bench, id_ = bench_of(request), request.path_params["id"]
    async with _form(request, bench):
        pass
    await run_in_threadpool(bench.runner.stop, id_)
    return _to(f"/sessions/{id_}")


async def export(request: Request) -> Response:
    """Request a certificate, corrected commands or an export."""
    bench, id_ = bench_of(request), request.path_params["id"]
    step = request.path_params["step"]
    folder = bench.cases.folder(id_)
    async with _form(request, bench) as form:
        options: dict[str, str] = {}
        wanted(bench.cases.get(id_), step, options)
        if step == "certificate":
            write_document(folder / "about.yaml", _about(form))
        elif step == "commands":
            stream, name = _only(form, "targets", "a CSV file of points")
            options["targets"] = "targets.csv"
            with written_whole(folder / "targets.csv") as beside:
                copy(stream, name, beside, MOST_SMALL)
    bench.cases.change(id_, lambda case: wanted(case, step, options))
    bench.runner.take(id_)
    return _to(f"/sessions/{id_}#exports")


async def log(request: Request) -> Response:
    """Compare all sessions of a machine."""
    bench = bench_of(request)
    async with _form(request, bench) as form:
        machine = _line(form, "name")
    known = await run_in_threadpool(bench.sessions, machine)
    id_ = bench.cases.new_id()
    steps, count = first_steps(LOG, ""), {"sessions": str(len(known))}
    bench.cases.add(Case(id_, LOG, "", machine, "", _now(), waiting=steps, options=count))
    bench.runner.take(id_)
    return RedirectResponse(request.url_for("machine").include_query_params(name=machine), 303)


async def order(request: Request) -> Response:
    """Give a confirmed order to a node of the cell."""
    bench = bench_of(request)
    async with _form(request, bench) as form:
        node, name = _line(form, "node"), _line(form, "order")
    if bench.cell is None:
        raise InputError("this bench does not watch a cell (delta-cal serve --no-cell)")
    bench.cell.order(node, name)
    return _to("/cell")


@asynccontextmanager
async def _form(request: Request, bench: Bench) -> AsyncIterator[FormData]:
    """Fields of a request whose form key is valid; uploaded files are closed afterwards."""
    async with request.form(max_files=_MOST_FILES, max_fields=_MOST_FIELDS) as form:
        bench.secrets.require_key(_text(form, "key"))
        yield form


def _dropped(bench: Bench, form: FormData, id_: str, folder: Path) -> Case:
    """Create the case of a dropped session or table, and store its files in its folder.

    Raises:
        InputError: a file or a field is not valid.
    """
    machine = _line(form, "machine")
    robot = _robot(bench, form, machine, folder)
    dropped = take_all(_files(form, "files"), folder, bench.most)
    options = {"table": dropped.path}
    if dropped.kind == TABLE:
        options |= _table_options(form, folder)
    return Case(
        id_,
        dropped.kind,
        dropped.name,
        machine,
        robot,
        _now(),
        waiting=first_steps(dropped.kind, options.get("preset", "")),
        session="" if dropped.kind == TABLE else dropped.path,
        topics=tuple(line.strip() for line in _text(form, "topics").splitlines() if line.strip()),
        options=options,
    )


def _robot(bench: Bench, form: FormData, machine: str, folder: Path) -> str:
    """Choose the robot: an uploaded file, that of a known machine, or one of the package.

    Raises:
        InputError: no robot was chosen, or the file is not a robot file.
    """
    own = _files(form, "robot_file")
    if own:
        copy(*own[0], folder / _ROBOT, MOST_SMALL)
        load_robot(folder / _ROBOT)
        return _ROBOT
    known = dict(bench.machines())
    chosen = _line(form, "robot")
    if machine in known and not chosen:
        return known[machine]
    if chosen not in known_robots():
        raise InputError(
            f"robot {chosen!r}: not a robot of the package; choose one, or give its file"
        )
    return chosen


def _table_options(form: FormData, folder: Path) -> dict[str, str]:
    """Options for reading a table: its format, and a second table."""
    options = {name: _line(form, name) for name in ("preset", "other_preset", "by", "unit")}
    for name in ("preset", "other_preset"):
        if options[name]:
            preset(options[name])
    if options["by"] not in ("", *_WAYS) or options["unit"] not in _UNITS:
        raise InputError("the form of the table: a value that the page does not offer")
    other = _files(form, "other")
    if other:
        stream, given = other[0]
        path = f"other/{file_name(given, 'table.csv')}"
        (folder / "other").mkdir()
        copy(stream, given, folder / path, MOST_TEXT)
        options["other"] = path
    return options


def _about(form: FormData) -> dict[str, Any]:
    """Content of the `--about` file of a certificate; empty fields are omitted.

    Raises:
        InputError: a numeric field does not contain a number.
    """
    told: dict[str, Any] = {}
    for name, (*outer, last) in {**_STATED, **_STATED_NUMBERS}.items():
        if text := _line(form, name):
            into = told.setdefault(outer[0], {}) if outer else told
            into[last] = _number(name, text) if name in _STATED_NUMBERS else text
    return told


def _number(name: str, text: str) -> float:
    value = number_of(text.replace(",", "."))
    if isnan(value):
        raise InputError(f"{name}: {text!r} is not a number")
    return value


def _write_mapping(path: Path, text: str) -> None:
    if len(text) > MOST_SMALL:
        raise InputError("the mapping is too long")
    with written_whole(path) as beside:
        beside.write_text(text.replace("\r\n", "\n"), encoding="utf-8")


def _files(form: FormData, name: str) -> list[tuple[IO[bytes], str]]:
    """Files of a field, without the empty one that a browser sends if no file was chosen."""
    given = [item for item in form.getlist(name) if isinstance(item, UploadFile)]
    return [(item.file, item.filename) for item in given if item.filename]


def _only(form: FormData, name: str, what: str) -> tuple[IO[bytes], str]:
    given = _files(form, name)
    if not given:
        raise InputError(f"no file was chosen; {what} is expected")
    return given[0]


def _text(form: FormData, name: str) -> str:
    value = form.get(name, "")
    return value if isinstance(value, str) else ""


def _line(form: FormData, name: str) -> str:
    """Read a one-line field.

    Raises:
        InputError: it is too long, or has non-printable characters.
    """
    value = _text(form, name).strip()
    if len(value) > _LONGEST or not value.isprintable():
        raise InputError(f"{name}: one line of at most {_LONGEST} characters is allowed")
    return value


def _now() -> str:
    return datetime.now(timezone.utc).isoformat(timespec="seconds")


def _to(path: str) -> Response:
    return RedirectResponse(path, 303)
