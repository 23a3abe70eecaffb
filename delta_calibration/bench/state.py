"""State that all request handlers of one server share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import jinja2
from starlette.responses import HTMLResponse

from delta_calibration import __version__
from delta_calibration.bench.cases import Cases
from delta_calibration.bench.cell import Cell
from delta_calibration.bench.guard import Secrets
from delta_calibration.bench.runner import Runner
from delta_calibration.history.store import Entry, open_store


@dataclass(frozen=True)
class Bench:
    """A running bench.

    Attributes:
        data: folder of all its data.
        cases: dropped sessions and tables, and change logs.
        runner: runs the steps of the cases.
        store: file or URL of the history.
        secrets: secrets of this server.
        cell: watches a running cell; None with `--no-cell`.
        most: most bytes of an upload.
        templates: templates of the pages.
    """

    data: Path
    cases: Cases
    runner: Runner
    store: str
    secrets: Secrets
    cell: Cell | None
    most: int
    templates: jinja2.Environment

    def page(self, template: str, status: int = 200, **values: Any) -> HTMLResponse:
        """Render a template as the answer to a request."""
        text = self.templates.get_template(f"{template}.html.j2").render(
            key=self.secrets.key, version=__version__, most=self.most, **values
        )
        return HTMLResponse(text, status)

    def machines(self) -> tuple[tuple[str, str], ...]:
        """Name and robot of every machine of the history."""
        if "://" not in self.store and not Path(self.store).is_file():
            return ()  # the store is created with the first session
        with open_store(self.store) as store:
            return store.machines()

    def sessions(self, machine: str) -> Sequence[Entry]:
        """Sessions of a machine, the earliest first.

        Raises:
            InputError: no such machine.
        """
        with open_store(self.store) as store:
            return store.sessions(machine)


def environment() -> jinja2.Environment:
    """Load the templates; all values are escaped, so that they are shown as plain text."""
    return jinja2.Environment(
        loader=jinja2.FunctionLoader(_template),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _template(name: str) -> str:
    folder = resources.files("delta_calibration").joinpath("bench", "templates")
    return folder.joinpath(name).read_text("utf-8")
