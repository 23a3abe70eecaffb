"""Content of the page of a case: its verdict in words, mistakes, progress and downloads."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from delta_calibration.bench.cases import Case
from delta_calibration.bench.flow import MAPPING, STEPS, check_file
from delta_calibration.bench.runner import commands, doing, told
from delta_calibration.diagnosis import Finding, Verdict
from delta_calibration.report import read_verdict
from delta_calibration.robot import Robot, load_robot
from delta_calibration.texts import read_text
from delta_calibration.wording import capital, listed, measured, mm, plain, spoken, sure

_VALUES = 16  # most values that are shown of a cause, the most significant ones
DOWNLOADS = {
    "report.html": "Report, a page to read and sign",
    "certificate.pdf": "Certificate, to print",
    "certificate.html": "Certificate, as a page",
    "calibration.yaml": "Calibration, geometry only",
    "extended.yaml": "Extended calibration, with the causes that were found",
    "commands.csv": "Corrected joint commands",
    "machine.c": "The machine as C, source",
    "machine.h": "The machine as C, header",
    "machine.urdf": "The machine as URDF",
    "log.html": "Change log, as a page",
    "verdict.json": "Verdict, for programs",
    "certificate.json": "Certificate, for programs",
    MAPPING: "Mapping of the table",
}
_UPDATE = "Calibration, fitted with the results of the history, including causes found before"


@dataclass(frozen=True)
class Row:
    """A row of a table with two columns."""

    name: str
    value: str


@dataclass(frozen=True)
class Cause:
    """A finding, in words."""

    title: str
    lines: tuple[str, ...]


@dataclass(frozen=True)
class Shown:
    """A verdict, in words."""

    sentence: str
    models: tuple[Row, ...]
    causes: tuple[Cause, ...]
    unknown: tuple[str, ...]
    cannot_tell: tuple[str, ...]


@dataclass(frozen=True)
class Progress:
    """Progress of a case: a sentence, and the present part out of the number of parts."""

    sentence: str
    number: int = 0
    of: int = 0


def progress(case: Case, folder: Path) -> Progress | None:
    """Present progress of a case; None if nothing is running or waiting."""
    if case.state != "working":
        return None
    if not case.step:
        return Progress("Waiting for the sessions that were added before")
    part = doing(folder, case.step)
    if part is None:
        return Progress(STEPS[case.step])
    return Progress(f"{STEPS[case.step]}: {part.name}", part.number, part.of)


def verdict_of(case: Case, folder: Path) -> Shown | None:
    """Verdict of a case in words; None if there is none yet."""
    path = folder / "verdict.json"
    if not path.is_file():
        return None
    return shown(read_verdict(path).verdict, _robot(case, folder))


def shown(verdict: Verdict, robot: Robot) -> Shown:
    """Put a verdict into words, with the robot file's own names."""
    named = robot.named
    noise = () if verdict.noise_mm is None else (Row("noise of a pose", mm(verdict.noise_mm)),)
    return Shown(
        named(verdict.sentence()),
        (
            *(Row(named(f"{n}: {m.model}"), mm(m.held_out_rms_mm)) for n, m in verdict.models()),
            *noise,
        ),
        tuple(_cause(finding, robot) for finding in verdict.findings),
        tuple(map(named, _unknown(verdict))),
        tuple(
            named(capital(f"{listed(map(spoken, e.between))}: {e.why()}"))
            for e in verdict.cannot_tell
        ),
    )


def _cause(finding: Finding, robot: Robot) -> Cause:
    values = ", ".join(
        f"{name} {plain(measured(e.value, e.std, e.unit))}"
        for name, e in finding.clearest(_VALUES).items()
    )
    lines = [f"found: {values}", finding.errors(), *finding.found_in_full()]
    if finding.equivalents:
        others = listed(map(spoken, finding.equivalents))
        lines.append(f"indistinguishable here: {others}{finding.to_separate()}")
    title = f"{capital(finding.called())}, {sure(finding.confidence)} sure"
    return Cause(robot.named(title), tuple(robot.named(capital(line)) for line in lines))


def _unknown(verdict: Verdict) -> list[str]:
    left = verdict.unknown_structure
    if not left.found:
        return []
    size = f", {left.rms_mm:.4f} mm RMS" if left.rms_mm is not None else ""
    where = f"; {left.where}" if left.where else ""
    laws = [
        f"Law at {law.part} ({law.stage}), {sure(law.probability)} likely: {law.equation}"
        for law in left.laws
    ]
    return [f"Unexplained structure{size}: varies with {left.moves()}{where}", *laws]


def mistakes(case: Case, folder: Path) -> list[dict[str, Any]]:
    """Mistakes that the check found in the current session, each with a title."""
    found: list[dict[str, Any]] = json.loads(read_text(folder / check_file(case)))["found"]
    return [{**m, "title": _mistake_title(m)} for m in found]


def _mistake_title(mistake: Mapping[str, Any]) -> str:
    part = f" ({spoken(mistake['part'])})" if mistake["part"] else ""
    size = ""
    if mistake["value"] is not None:
        unit = mistake["unit"] if mistake["unit"] != "1" else ""
        size = f": {mistake['value']:.6g} {unit}".rstrip()
    title = f"{spoken(mistake['mistake'])} in {spoken(mistake['stream'])}{part}{size}"
    return capital(title)


def columns(folder: Path) -> dict[str, Any]:
    """Guessed meaning of a table's columns, with the text of the mapping file."""
    guessed: dict[str, Any] = json.loads(read_text(folder / "columns.json"))
    return {**guessed, "text": read_text(folder / MAPPING)}


def files(folder: Path) -> list[tuple[str, str]]:
    """Name and description of every file that can be downloaded."""
    update = {"calibration.yaml": _UPDATE} if told(folder, "update") else {}
    every = {**DOWNLOADS, **update}
    return [(name, said) for name, said in every.items() if (folder / name).is_file()]


def outputs(folder: Path) -> list[tuple[str, str]]:
    """Title and standard output of every step that was run."""
    said = [(STEPS[step], told(folder, step)) for step in STEPS]
    return [(title, text) for title, text in said if text]


def history_of_commands(folder: Path) -> str:
    """Command lines that were run in a case's folder, one per line."""
    return "\n".join(commands(folder))


def _robot(case: Case, folder: Path) -> Robot:
    own = folder / case.robot
    return load_robot(own if own.is_file() else case.robot)
