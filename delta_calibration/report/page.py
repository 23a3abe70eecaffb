"""Report as one HTML file that opens offline: text by an escaping template, plots by plotly.

The page contains plotly's script, and a content security policy that forbids all requests to any
host.
"""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path
from typing import Any

from delta_calibration import __version__
from delta_calibration.accuracy import IsoReport
from delta_calibration.diagnosis.diagnose import Diagnosis
from delta_calibration.files import written_whole
from delta_calibration.report.browser import places_of, plot_of
from delta_calibration.report.document import Report
from delta_calibration.report.missing import required
from delta_calibration.report.provenance import Provenance
from delta_calibration.report.session_report import report_of
from delta_calibration.robot import Robot


def build_page(
    diagnosis: Diagnosis,
    robot: Robot,
    provenance: Provenance,
    iso: IsoReport | str = "not requested",
) -> str:
    """Make the report of a diagnosis as HTML; see `report_of`."""
    return page_of(report_of(diagnosis, robot, provenance, iso))


def page_of(report: Report) -> str:
    """Convert a report to HTML.

    Raises:
        InputError: jinja2 or plotly is not installed.
    """
    jinja2 = required("jinja2")
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(_template),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    plots, places = _plots(report)
    safe = required("markupsafe").Markup
    page: str = environment.get_template("page.html.j2").render(
        report=report,
        places=places,
        scale_places=places_of,
        version=__version__,
        style=safe(_template("page.css")),
        script=safe(_template("page.js")),
        plotly=safe(_inline(required("plotly.offline").get_plotlyjs())) if plots else "",
        plots=safe(_inline(json.dumps(plots, ensure_ascii=False, allow_nan=False))),
    )
    return page


def write_page(path: Path, report: Report) -> None:
    """Write a report as an HTML file atomically.

    Raises:
        InputError: a library is missing, or the file cannot be written.
    """
    text = page_of(report)
    with written_whole(path) as beside:
        beside.write_text(text, encoding="utf-8")


def _plots(report: Report) -> tuple[dict[str, Any], dict[str, list[str]]]:
    """Panels by the id of their HTML element, and the ids of each figure."""
    plots: dict[str, Any] = {}
    places: dict[str, list[str]] = {}
    for figure in report.figures():
        ids = [f"plot-{figure.name}-{number}" for number in range(len(figure.panels))]
        places[figure.name] = ids
        plots |= {id_: plot_of(panel) for id_, panel in zip(ids, figure.panels, strict=True)}
    return plots, places


def _inline(text: str) -> str:
    """Escape script or data so that it cannot close its HTML element."""
    return text.replace("</", "<\\/").replace("<!--", "<\\!--")


def _template(name: str) -> str:
    folder = resources.files("delta_calibration").joinpath("report", "templates")
    return folder.joinpath(name).read_text("utf-8")
