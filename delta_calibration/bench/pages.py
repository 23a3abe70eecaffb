"""Handlers of GET requests: pages of sessions, machines and the cell, and files to download."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import quote

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, Response

from delta_calibration.bench.cases import LOG
from delta_calibration.bench.cell import ORDERS
from delta_calibration.bench.guard import APART
from delta_calibration.bench.runner import told
from delta_calibration.bench.shown import (
    DOWNLOADS,
    columns,
    files,
    history_of_commands,
    mistakes,
    outputs,
    progress,
    verdict_of,
)
from delta_calibration.bench.state import Bench
from delta_calibration.recording.presets import overview
from delta_calibration.robot import known_robots

_ASIDE = ("written: ",)  # first words of output lines that are not part of the change log


def bench_of(request: Request) -> Bench:
    """The bench that a request is for."""
    bench: Bench = request.app.state.bench
    return bench


def home(request: Request) -> Response:
    """Home page: an area to drop a session, and the list of all dropped sessions."""
    bench = bench_of(request)
    cases = [case for case in bench.cases.all() if case.kind != LOG]
    doing = {case.id: progress(case, bench.cases.folder(case.id)) for case in cases}
    return bench.page(
        "home",
        here="sessions",
        cases=cases,
        doing=doing,
        robots=known_robots(),
        machines=bench.machines(),
        presets=overview(),
    )


def session(request: Request) -> Response:
    """Page of one session: its progress, question, verdict and files."""
    bench = bench_of(request)
    case = bench.cases.get(request.path_params["id"])
    folder = bench.cases.folder(case.id)
    return bench.page(
        "session",
        here="sessions",
        case=case,
        progress=progress(case, folder),
        verdict=verdict_of(case, folder),
        updated=told(folder, "update"),
        mistakes=mistakes(case, folder) if case.question == "mistakes" else [],
        columns=columns(folder) if case.question == "columns" else {},
        presets=overview(),
        files=files(folder),
        outputs=outputs(folder),
        commands=history_of_commands(folder),
    )


def machines(request: Request) -> Response:
    """Page of the machines in the history."""
    bench = bench_of(request)
    known = [(name, robot, len(bench.sessions(name))) for name, robot in bench.machines()]
    return bench.page("machines", here="machines", machines=known, quote=_quoted)


def machine(request: Request) -> Response:
    """Page of one machine: its sessions and its change log."""
    bench, name = bench_of(request), request.query_params.get("name", "")
    entries = bench.sessions(name)
    logs = [case for case in bench.cases.all() if case.kind == LOG and case.machine == name]
    log = logs[0] if logs else None
    folder = bench.cases.folder(log.id) if log else None
    return bench.page(
        "machine",
        here="machines",
        name=name,
        robot=dict(bench.machines())[name],
        entries=[(entry, _case_of(bench, Path(entry.path))) for entry in entries],
        log=log,
        progress=progress(log, folder) if log and folder else None,
        changes=_sentences(folder) if folder else [],
        files=files(folder) if folder else [],
        newer=len(entries) - int(log.option("sessions", "0")) if log else 0,
    )


def cell(request: Request) -> Response:
    """Page of the nodes of a running cell."""
    bench = bench_of(request)
    watched = bench.cell
    return bench.page(
        "cell",
        here="cell",
        watched=watched is not None,
        trouble=watched.trouble if watched else "",
        nodes=watched.nodes() if watched else (),
        answers=watched.answers() if watched else (),
        orders=ORDERS,
        quote=_quoted,
    )


def confirm(request: Request) -> Response:
    """Page that asks for confirmation before an order goes to a cell."""
    node, order = (request.query_params.get(name, "") for name in ("node", "order"))
    if order not in ORDERS:
        raise HTTPException(404, "there is no such order")
    title, known = ORDERS[order]
    return bench_of(request).page(
        "confirm", here="cell", node=node, order=order, title=title, known=known
    )


def file(request: Request) -> Response:
    """Download of a file of a session; with `?show=1` an HTML file is displayed instead."""
    bench, name = bench_of(request), request.path_params["name"]
    case = bench.cases.get(request.path_params["id"])
    path = bench.cases.folder(case.id) / name
    if name not in DOWNLOADS or not path.is_file():
        raise HTTPException(404, "there is no such file")
    if request.query_params.get("show") and path.suffix == ".html":
        return FileResponse(path, headers={"content-security-policy": APART})
    return FileResponse(path, filename=f"{case.name or case.machine}_{name}")


def _case_of(bench: Bench, path: Path) -> str:
    """Id of the case whose folder contains a session of the history; empty if none does."""
    home_ = (bench.data / "cases").resolve()
    inside = path.is_relative_to(home_)
    return path.relative_to(home_).parts[0] if inside else ""


def _sentences(folder: Path) -> list[str]:
    """Lines of the change log, from the output of the verb."""
    lines = told(folder, "log").splitlines()
    return [line for line in lines if line.strip() and not line.startswith(_ASIDE)]


def _quoted(text: str) -> str:
    return quote(text, safe="")
