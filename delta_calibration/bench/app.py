"""The bench as an ASGI application, and the server that runs it."""

from __future__ import annotations

import errno
import fcntl
import os
import secrets
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import resources
from pathlib import Path

import uvicorn
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from delta_calibration.bench import forms, pages
from delta_calibration.bench.cases import Cases
from delta_calibration.bench.cell import Cell
from delta_calibration.bench.guard import Guard, Secrets
from delta_calibration.bench.runner import Runner
from delta_calibration.bench.state import Bench, environment
from delta_calibration.errors import CalibrationError, InputError, MistakeError

_LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
_STATIC = {  # name: folder in the package, media type
    "page.css": (("report", "templates"), "text/css"),
    "bench.css": (("bench", "static"), "text/css"),
    "bench.js": (("bench", "static"), "text/javascript"),
}
_TAKEN = "; another program listens there: give another --port, or 0 for a free one"
_FORMS = 4 << 20  # most bytes of a form without its files


def application(bench: Bench, hosts: frozenset[str]) -> Starlette:
    """Create the ASGI application of a bench.

    Args:
        bench: bench that is served.
        hosts: allowed values of the `Host` header, with the port.
    """
    guard = Middleware(Guard, secrets=bench.secrets, hosts=hosts, most=bench.most + _FORMS)
    app = Starlette(
        routes=[
            Route("/", pages.home),
            Route("/sessions", forms.drop, methods=["POST"]),
            Route("/sessions/{id}", pages.session),
            Route("/sessions/{id}/answer", forms.answer, methods=["POST"]),
            Route("/sessions/{id}/stop", forms.stop, methods=["POST"]),
            Route("/sessions/{id}/exports/{step}", forms.export, methods=["POST"]),
            Route("/sessions/{id}/files/{name}", pages.file),
            Route("/machines", pages.machines),
            Route("/machine", pages.machine, name="machine"),
            Route("/machine/log", forms.log, methods=["POST"]),
            Route("/cell", pages.cell),
            Route("/cell/confirm", pages.confirm),
            Route("/cell/order", forms.order, methods=["POST"]),
            Route("/static/{name}", _static),
        ],
        middleware=[guard],
        exception_handlers={HTTPException: _on_http, CalibrationError: _on_mistake},
    )
    app.state.bench = bench
    return app


@contextmanager
def opened(
    data: Path, most: int, workers: int = 1, watch: bool = True, store: str | None = None
) -> Iterator[Bench]:
    """Yield a bench on a data folder; it processes its cases until the context ends.

    Args:
        data: folder of all its data; created if missing.
        most: most bytes of an upload.
        workers: number of sessions that are processed at once.
        watch: whether to watch a running cell.
        store: file or URL of the history; by default `history.sqlite` in the folder.

    Raises:
        InputError: the folder cannot be created, or another server uses it.
    """
    try:
        data.mkdir(mode=0o700, parents=True, exist_ok=True)
        lock = (data / "lock").open("w")
    except OSError as error:
        raise InputError(f"{data}: cannot be used: {error.strerror or error}") from error
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise InputError(f"{data}: another `delta-cal serve` uses this folder") from error
        cases, url = Cases(data / "cases"), _url(store or str(data / "history.sqlite"))
        runner = Runner(cases, url, workers)
        cell = Cell() if watch else None
        try:
            key = Secrets(_token(data / "token"))
            yield Bench(data, cases, runner, url, key, cell, most, environment())
        finally:
            runner.close()
            if cell is not None:
                cell.close()


def serve(
    bench: Bench, address: str, port: int, names: tuple[str, ...], told: Callable[[str], None]
) -> None:
    """Serve a bench until a signal ends the process.

    Args:
        bench: bench that is served.
        address: address to listen on.
        port: port to listen on; 0 takes a free one.
        names: further host names under which browsers reach this server.
        told: callback that gets the link to open, once the server listens.

    Raises:
        InputError: the server cannot listen on the address.
    """
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as listening:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind((address, port))
        except OSError as error:
            raise InputError(
                f"--address {address} --port {port}: cannot be opened for listening: "
                f"{error.strerror or error}{_TAKEN if error.errno == errno.EADDRINUSE else ''}"
            ) from error
        listening.listen()
        port = listening.getsockname()[1]
        shown = f"[{address}]" if ":" in address else address
        known = (*_LOOPBACK, shown, *names)
        # browsers omit the default port, which a proxy in front of this server may listen on
        hosts = frozenset(f"{name}:{port}".lower() for name in known) | {n.lower() for n in names}
        told(f"http://{names[0] if names else shown}:{port}/?token={bench.secrets.token}")
        # no access log: the first request of every browser contains the token
        config = uvicorn.Config(
            application(bench, hosts),
            log_level="warning",
            access_log=False,
            server_header=False,
            proxy_headers=False,
            timeout_graceful_shutdown=2,
        )
        uvicorn.Server(config).run(sockets=[listening])


def write_door(data: Path, link: str) -> Path:
    """Write a page that redirects to the link, so that no command line shows the token.

    Only its owner can read the page.

    Args:
        data: folder to write it to.
        link: link with the token.
    """
    path = data / "open.html"
    path.unlink(missing_ok=True)
    descriptor = os.open(path, os.O_CREAT | os.O_WRONLY | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "w", encoding="ascii") as file:
        file.write(f'<meta http-equiv="refresh" content="0; url={link}">\n')
    return path


def _url(store: str) -> str:
    """Path or URL of a store that is valid from any working directory."""
    return store if "://" in store else str(Path(store).resolve())


def _token(path: Path) -> str:
    """Read or create the token of a data folder; only its owner can read the file."""
    try:
        return path.read_text(encoding="ascii").strip()
    except FileNotFoundError:
        token = secrets.token_urlsafe(32)
        descriptor = os.open(path, os.O_CREAT | os.O_WRONLY | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w", encoding="ascii") as file:
            file.write(token)
        return token


def _static(request: Request) -> Response:
    name = request.path_params["name"]
    if name not in _STATIC:
        raise HTTPException(404, "there is no such file")
    folder, kind = _STATIC[name]
    content = resources.files("delta_calibration").joinpath(*folder, name).read_text("utf-8")
    return Response(content, media_type=kind)


def _on_http(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return _refused(request, error.status_code, error.detail)


def _on_mistake(request: Request, error: Exception) -> Response:
    """Answer an error of the user: status 409 if somebody else was first, otherwise 400."""
    return _refused(request, 409 if isinstance(error, MistakeError) else 400, str(error))


def _refused(request: Request, status: int, said: str) -> Response:
    return pages.bench_of(request).page("refused", status, here="", said=said)
