"""Overview shown by `delta-cal --help`: the verbs by purpose, with an example of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import click


class Verb(NamedTuple):
    """Text on a verb in the overview; kept here, so that the verb's module need not be loaded.

    Attributes:
        about: purpose of the verb.
        example: arguments of an example call.
    """

    about: str
    example: str


# purpose: verbs in the order of use
PURPOSES: Mapping[str, Mapping[str, Verb]] = {
    "Measure": {
        "plan": Verb(
            "plan where to measure, from which side and with what load",
            "--robot srbd --identify --out poses.csv",
        ),
        "simulate": Verb(
            "record a session of a simulated machine with errors",
            "--robot srbd --effect backlash:strength=1 --out session",
        ),
        "import": Verb(
            "make a session from your own table (CSV, Excel)",
            "table.csv --mapping mapping.yaml --robot srbd --out session",
        ),
    },
    "Look": {
        "info": Verb(
            "topics, rates and origin of a session",
            "session",
        ),
        "check": Verb(
            "find mistakes in units, wiring, clocks and frames",
            "session --robot srbd --fix mended",
        ),
        "recover": Verb(
            "repair a recording that was cut off",
            "session --out whole",
        ),
        "replay": Verb(
            "play a session on its topics, with /clock",
            "session --rate 10",
        ),
        "urdf": Verb(
            "the robot as URDF, for RViz and Foxglove",
            "--robot srbd --out srbd.urdf",
        ),
        "robot": Verb(
            "write, check and draw a robot file",
            "draw srbd --out srbd.svg",
        ),
    },
    "Find out": {
        "fit": Verb(
            "identify the real geometry of the machine",
            "session --robot srbd --out calibration.yaml",
        ),
        "diagnose": Verb(
            "name the causes of the errors that calibration leaves",
            "session --robot srbd --json verdict.json --out extended.yaml",
        ),
        "circle": Verb(
            "how round circles are, what spoils them, what to do first",
            "session --robot srbd --json circles.json --report circles.html",
        ),
        "printer": Verb(
            "calibrate a Delta printer from its own probe (Klipper)",
            "printer.cfg --out identified.cfg",
        ),
    },
    "Put right": {
        "compensate": Verb(
            "corrected joint commands for a list of targets",
            "--robot srbd --calibration extended.yaml points.csv --out joints.csv",
        ),
        "export": Verb(
            "hand the identified machine to other controllers",
            "--robot srbd --calibration extended.yaml --format c --out machine.c",
        ),
    },
    "Judge and sign": {
        "iso9283": Verb(
            "accuracy and repeatability by the standard's criteria",
            "session --robot srbd --json iso.json",
        ),
        "report": Verb(
            "a one-page report on a session, to read and sign",
            "session --robot srbd --out report.html",
        ),
        "certificate": Verb(
            "a calibration certificate to sign (PDF, HTML, DCC)",
            "session --robot srbd --about about.yaml --out certificate.pdf",
        ),
        "compare": Verb(
            "how calibrations or verdicts drift over months",
            "january.json june.json --out drift.html",
        ),
        "history": Verb(
            "keep the sessions of a machine and report what changed, and when",
            "changes --machine press_3",
        ),
        "fleet": Verb(
            "work through many machines on a cluster",
            "machines --scheduler tcp://host:8786",
        ),
    },
    "Protect": {
        "sros2": Verb(
            "write an SROS 2 policy with the permissions of the nodes",
            "--policy --out policy.xml",
        ),
    },
    "Begin": {
        "demo": Verb(
            "a live simulated cell, from measurement to compensation",
            "--out out/demo",
        ),
        "serve": Verb(
            "do all of this on a page in the browser",
            "--data bench",
        ),
        "completion": Verb(
            "let the shell complete verbs, options and names",
            "bash",
        ),
    },
}

TOLD: Mapping[str, Verb] = {
    verb: told for verbs in PURPOSES.values() for verb, told in verbs.items()
}


def write_verbs(formatter: click.HelpFormatter, verbs: Sequence[str]) -> None:
    """Write the verbs under their purposes, with an example of each."""
    for purpose, every in PURPOSES.items():
        here = {verb: told for verb, told in every.items() if verb in verbs}
        if here:
            with formatter.section(purpose):
                _write(formatter, here)


def _write(formatter: click.HelpFormatter, verbs: Mapping[str, Verb]) -> None:
    for verb, (about, example) in verbs.items():
        formatter.write(f"{'':{formatter.current_indent}}{verb:<12}{about}\n")
        formatter.write(f"{'':{formatter.current_indent + 4}}$ delta-cal {verb} {example}\n")
